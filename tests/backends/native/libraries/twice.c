/* Registers under two names, explicitly. */
#include <nros/rmw_vtable.h>
static int32_t refused(void) { return NROS_RMW_RET_CONNECTION_FAILED; }
static void *vtable[35];
nros_rmw_ret_t nros_rmw_one_register(void) {
    for (int i = 0; i < 19; i++) vtable[i] = (void *)refused;
    nros_rmw_cffi_register_named("one", (const nros_rmw_vtable_t *)vtable);
    return nros_rmw_cffi_register_named("two", (const nros_rmw_vtable_t *)vtable);
}
