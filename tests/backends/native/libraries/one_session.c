/* The example, but a second session at a time is refused. */
#include "loopback.c"
static bool taken;
static nros_rmw_ret_t create_one(const char *locator, uint8_t mode, uint32_t domain, const char *node,
                                 nros_rmw_session_t *out) {
    if (taken) return NROS_RMW_RET_BAD_ALLOC;
    nros_rmw_ret_t code = create_session(locator, mode, domain, node, out);
    taken = code == NROS_RMW_RET_OK;
    return code;
}
static nros_rmw_ret_t destroy_one(nros_rmw_session_t *handle) {
    nros_rmw_ret_t code = destroy_session(handle);
    taken = code != NROS_RMW_RET_OK;
    return code;
}
static nros_rmw_vtable_t vtable;
__attribute__((constructor)) static void register_it(void) {
    vtable = loopback_vtable;
    vtable.create_session = create_one, vtable.destroy_session = destroy_one;
    nros_rmw_cffi_register_named("loopback", &vtable);
}
