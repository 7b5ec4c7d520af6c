/* The C boundary between nano-ros and a middleware backend, as far as this example needs it.
 *
 * Written for this example from the layout of nano-ros 0.5.0 (commit 9a7a150). A backend of yours is
 * compiled against nano-ros' own headers instead: the include line stays the same.
 * `nros-conformance run --native ... --headers DIR` compares the headers in DIR with this layout. */
#ifndef NROS_RMW_VTABLE_H
#define NROS_RMW_VTABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* 0 or a byte count is success, everything else is one of these. */
typedef int32_t nros_rmw_ret_t;
#define NROS_RMW_RET_OK 0
#define NROS_RMW_RET_ERROR (-1)
#define NROS_RMW_RET_TIMEOUT (-2)
#define NROS_RMW_RET_BAD_ALLOC (-3)
#define NROS_RMW_RET_INVALID_ARGUMENT (-4)
#define NROS_RMW_RET_UNSUPPORTED (-5)
#define NROS_RMW_RET_INCOMPATIBLE_QOS (-6)
#define NROS_RMW_RET_TOPIC_NAME_INVALID (-7)
#define NROS_RMW_RET_NO_DATA (-10)
#define NROS_RMW_RET_WOULD_BLOCK (-11)
#define NROS_RMW_RET_BUFFER_TOO_SMALL (-12)
#define NROS_RMW_RET_MESSAGE_TOO_LARGE (-13)
#define NROS_RMW_RET_CONNECTION_FAILED (-18)

/* Durations of the QoS are milliseconds; 0 and this value both mean "no check". */
#define NROS_RMW_DURATION_INFINITE_MS UINT32_MAX

#define NROS_RMW_RELIABILITY_BEST_EFFORT 0
#define NROS_RMW_RELIABILITY_RELIABLE 1
#define NROS_RMW_DURABILITY_VOLATILE 0
#define NROS_RMW_DURABILITY_TRANSIENT_LOCAL 1
#define NROS_RMW_HISTORY_KEEP_LAST 0
#define NROS_RMW_HISTORY_KEEP_ALL 1

typedef enum nros_rmw_liveliness_kind_t {
    NROS_RMW_LIVELINESS_NONE = 0,
    NROS_RMW_LIVELINESS_AUTOMATIC = 1,
    NROS_RMW_LIVELINESS_MANUAL_BY_TOPIC = 2,
    NROS_RMW_LIVELINESS_MANUAL_BY_NODE = 3
} nros_rmw_liveliness_kind_t;

typedef struct nros_rmw_qos_t {
    uint8_t reliability;
    uint8_t durability;
    uint8_t history;
    uint8_t liveliness_kind;
    uint16_t depth;
    uint16_t _reserved0;
    uint32_t deadline_ms;
    uint32_t lifespan_ms;
    uint32_t liveliness_lease_ms;
    uint8_t avoid_ros_namespace_conventions;
    uint8_t _reserved1[3];
} nros_rmw_qos_t;

/* The runtime owns these structs, fills in the names and the QoS, and may hand over a fresh copy with
 * every call: keep `backend_data`, never a pointer to the struct. The names live until destroy. */
typedef struct nros_rmw_session_t {
    const char *node_name;
    const char *namespace_;
    uint8_t _reserved[8];
    void *backend_data;
} nros_rmw_session_t;

typedef struct nros_rmw_publisher_t {
    const char *topic_name;
    const char *type_name;
    nros_rmw_qos_t qos;
    bool can_loan_messages;
    uint8_t _reserved[7];
    void *backend_data;
} nros_rmw_publisher_t;

typedef struct nros_rmw_subscription_t {
    const char *topic_name;
    const char *type_name;
    nros_rmw_qos_t qos;
    bool can_loan_messages;
    uint8_t _reserved[7];
    void *backend_data;
} nros_rmw_subscription_t;

typedef struct nros_rmw_service_t {
    const char *service_name;
    const char *type_name;
    uint8_t _reserved[8];
    void *backend_data;
} nros_rmw_service_t;

typedef struct nros_rmw_client_t {
    const char *service_name;
    const char *type_name;
    uint8_t _reserved[8];
    void *backend_data;
} nros_rmw_client_t;

typedef struct nros_rmw_publisher_options_t {
    uint8_t tx_express;
    uint8_t _reserved[7];
} nros_rmw_publisher_options_t;

typedef struct nros_rmw_subscription_options_t {
    uint32_t rx_buffer_hint;
    uint8_t _reserved[4];
} nros_rmw_subscription_options_t;

typedef enum nros_rmw_event_kind_t {
    NROS_RMW_EVENT_LIVELINESS_CHANGED = 0,
    NROS_RMW_EVENT_REQUESTED_DEADLINE_MISSED = 1,
    NROS_RMW_EVENT_MESSAGE_LOST = 2,
    NROS_RMW_EVENT_LIVELINESS_LOST = 3,
    NROS_RMW_EVENT_OFFERED_DEADLINE_MISSED = 4
} nros_rmw_event_kind_t;

typedef struct nros_rmw_liveliness_changed_status_t {
    uint16_t alive_count;
    uint16_t not_alive_count;
    int16_t alive_count_change;
    int16_t not_alive_count_change;
} nros_rmw_liveliness_changed_status_t;

typedef struct nros_rmw_count_status_t {
    uint32_t total_count;
    uint32_t total_count_change;
} nros_rmw_count_status_t;

typedef union nros_rmw_event_payload_t {
    nros_rmw_liveliness_changed_status_t liveliness_changed;
    nros_rmw_count_status_t count;
} nros_rmw_event_payload_t;

/* Called from inside drive_io, on the thread that called it, and from nowhere else. */
typedef void (*nros_rmw_event_callback_t)(nros_rmw_event_kind_t kind, const nros_rmw_event_payload_t *payload,
                                          void *user_context);

/* The order of the slots is the ABI. A slot that may be NULL says what the runtime then answers. */
typedef struct nros_rmw_vtable_t {
    nros_rmw_ret_t (*create_session)(const char *locator, uint8_t mode, uint32_t domain_id, const char *node_name,
                                     nros_rmw_session_t *out);
    nros_rmw_ret_t (*destroy_session)(nros_rmw_session_t *session);
    nros_rmw_ret_t (*drive_io)(nros_rmw_session_t *session, int32_t timeout_ms);
    nros_rmw_ret_t (*create_publisher)(nros_rmw_session_t *session, const char *topic_name, const char *type_name,
                                       const char *type_hash, uint32_t domain_id, const nros_rmw_qos_t *qos,
                                       const nros_rmw_publisher_options_t *options, nros_rmw_publisher_t *out);
    void (*destroy_publisher)(nros_rmw_publisher_t *publisher);
    nros_rmw_ret_t (*publish_raw)(nros_rmw_publisher_t *publisher, const uint8_t *data, size_t len);
    nros_rmw_ret_t (*create_subscription)(nros_rmw_session_t *session, const char *topic_name, const char *type_name,
                                          const char *type_hash, uint32_t domain_id, const nros_rmw_qos_t *qos,
                                          const nros_rmw_subscription_options_t *options,
                                          nros_rmw_subscription_t *out);
    void (*destroy_subscription)(nros_rmw_subscription_t *subscription);
    int32_t (*try_recv_raw)(nros_rmw_subscription_t *subscription, uint8_t *buf, size_t buf_len);
    int32_t (*has_data)(nros_rmw_subscription_t *subscription);
    nros_rmw_ret_t (*create_service)(nros_rmw_session_t *session, const char *service_name, const char *type_name,
                                     const char *type_hash, uint32_t domain_id, const nros_rmw_qos_t *qos,
                                     nros_rmw_service_t *out);
    void (*destroy_service)(nros_rmw_service_t *server);
    int32_t (*try_recv_request)(nros_rmw_service_t *server, uint8_t *buf, size_t buf_len, int64_t *seq_out);
    int32_t (*has_request)(nros_rmw_service_t *server);
    nros_rmw_ret_t (*send_reply)(nros_rmw_service_t *server, int64_t seq, const uint8_t *data, size_t len);
    nros_rmw_ret_t (*create_client)(nros_rmw_session_t *session, const char *service_name, const char *type_name,
                                    const char *type_hash, uint32_t domain_id, const nros_rmw_qos_t *qos,
                                    nros_rmw_client_t *out);
    void (*destroy_client)(nros_rmw_client_t *client);
    nros_rmw_ret_t (*send_request_raw)(nros_rmw_client_t *client, const uint8_t *request, size_t req_len);
    int32_t (*try_recv_reply_raw)(nros_rmw_client_t *client, uint8_t *reply_buf, size_t reply_buf_len);

    /* NULL: UNSUPPORTED, for these three. */
    nros_rmw_ret_t (*register_subscription_event)(nros_rmw_subscription_t *subscription, nros_rmw_event_kind_t kind,
                                                  uint32_t deadline_ms, nros_rmw_event_callback_t cb,
                                                  void *user_context);
    nros_rmw_ret_t (*register_publisher_event)(nros_rmw_publisher_t *publisher, nros_rmw_event_kind_t kind,
                                               uint32_t deadline_ms, nros_rmw_event_callback_t cb,
                                               void *user_context);
    nros_rmw_ret_t (*assert_publisher_liveliness)(nros_rmw_publisher_t *publisher);

    /* NULL: no deadline of its own, no wake-up, copies instead of loans and borrows. */
    int32_t (*next_deadline_ms)(const nros_rmw_session_t *session);
    nros_rmw_ret_t (*set_wake_callback)(nros_rmw_session_t *session, void (*cb)(void *ctx), void *ctx);
    nros_rmw_ret_t (*pub_loan)(nros_rmw_publisher_t *publisher, size_t requested_len, uint8_t **out_buf,
                               size_t *out_cap, void **out_token);
    nros_rmw_ret_t (*pub_commit)(nros_rmw_publisher_t *publisher, void *token, size_t actual_len);
    void (*pub_discard)(nros_rmw_publisher_t *publisher, void *token);
    int32_t (*sub_borrow)(nros_rmw_subscription_t *subscription, const uint8_t **out_buf, size_t *out_len,
                          void **out_token);
    void (*sub_release)(nros_rmw_subscription_t *subscription, void *token);

    /* NULL: UNSUPPORTED; one message after the other; through a buffer; UNSUPPORTED; buffered. */
    int32_t (*service_server_available)(nros_rmw_client_t *client);
    int32_t (*try_recv_sequence)(nros_rmw_subscription_t *subscription, uint8_t *buf, size_t per_msg_cap,
                                 size_t max_msgs, size_t *out_lens);
    nros_rmw_ret_t (*publish_streamed)(nros_rmw_publisher_t *publisher, void (*size_cb)(size_t *, void *),
                                       void (*chunk_cb)(uint8_t *, size_t, size_t *, void *), void *user_ctx);
    nros_rmw_ret_t (*ping_session)(nros_rmw_session_t *session, int32_t timeout_ms);
    int32_t (*subscription_supports_in_place)(nros_rmw_subscription_t *subscription);
    int32_t (*process_raw_in_place)(nros_rmw_subscription_t *subscription, void *ctx,
                                    void (*cb)(void *ctx, const uint8_t *ptr, size_t len));
} nros_rmw_vtable_t;

/* Provided by the runtime (here: by nros-conformance). Names have at most 31 bytes. */
nros_rmw_ret_t nros_rmw_cffi_register_named(const char *name, const nros_rmw_vtable_t *vtable);

#ifdef __cplusplus
}
#endif

#endif
