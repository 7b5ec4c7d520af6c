/* The service slots of a backend without services: creating is refused, the rest is never called. */
static nros_rmw_ret_t no_service(nros_rmw_session_t *s, const char *name, const char *type, const char *hash,
                                 uint32_t domain, const nros_rmw_qos_t *qos, nros_rmw_service_t *out) {
    return NROS_RMW_RET_UNSUPPORTED;
}
static nros_rmw_ret_t no_client(nros_rmw_session_t *s, const char *name, const char *type, const char *hash,
                                uint32_t domain, const nros_rmw_qos_t *qos, nros_rmw_client_t *out) {
    return NROS_RMW_RET_UNSUPPORTED;
}
static void no_service_gone(nros_rmw_service_t *s) {}
static void no_client_gone(nros_rmw_client_t *c) {}
static int32_t no_request(nros_rmw_service_t *s, uint8_t *buf, size_t len, int64_t *seq) {
    return NROS_RMW_RET_UNSUPPORTED;
}
static int32_t no_request_waits(nros_rmw_service_t *s) { return NROS_RMW_RET_UNSUPPORTED; }
static nros_rmw_ret_t no_reply(nros_rmw_service_t *s, int64_t seq, const uint8_t *data, size_t len) {
    return NROS_RMW_RET_UNSUPPORTED;
}
static nros_rmw_ret_t no_request_sent(nros_rmw_client_t *c, const uint8_t *request, size_t len) {
    return NROS_RMW_RET_UNSUPPORTED;
}
static int32_t no_reply_waits(nros_rmw_client_t *c, uint8_t *buf, size_t len) { return NROS_RMW_RET_UNSUPPORTED; }

#define SERVICES_REFUSED                                                                                              \
    .create_service = no_service, .destroy_service = no_service_gone, .try_recv_request = no_request,                 \
    .has_request = no_request_waits, .send_reply = no_reply, .create_client = no_client,                              \
    .destroy_client = no_client_gone, .send_request_raw = no_request_sent, .try_recv_reply_raw = no_reply_waits
