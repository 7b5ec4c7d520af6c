/* Compiled when the vtable had two slots less. */
#include <stdint.h>
typedef int32_t (*slot)(void);
int32_t nros_rmw_cffi_register_named(const char *name, const void *vtable);
static int32_t some(void) { return 0; }
static const slot vtable[33] = {some, some, some, some, some, some, some, some, some, some, some,
                                some, some, some, some, some, some, some, some, some, some, some,
                                some, some, some, some, some, some, some, some, some, some, some};
__attribute__((constructor)) static void register_it(void) { nros_rmw_cffi_register_named("older", vtable); }
