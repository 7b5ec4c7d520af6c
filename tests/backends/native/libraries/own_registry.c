/* The example with a registry of its own, as a language that links it in brings one. */
#include "loopback.c"
static const nros_rmw_vtable_t *registered;
nros_rmw_ret_t nros_rmw_cffi_register_named(const char *name, const nros_rmw_vtable_t *vtable) {
    registered = strcmp(name, "loopback") ? NULL : vtable;
    return NROS_RMW_RET_OK;
}
const nros_rmw_vtable_t *nros_rmw_cffi_lookup(const char *name) {
    return strcmp(name, "loopback") ? NULL : registered;
}
