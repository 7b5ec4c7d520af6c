/* A vtable of the right size that is wrong all the same: WRONG names the slot that holds VALUE. */
#include <stdint.h>
typedef int32_t (*slot)(void);
int32_t nros_rmw_cffi_register_named(const char *name, const void *vtable);
static int32_t some(void) { return 0; }
static char data[8];
static slot vtable[35];
__attribute__((constructor)) static void register_it(void) {
    for (int i = 0; i < 35; i++) vtable[i] = some;
    vtable[WRONG] = (slot)VALUE;
    nros_rmw_cffi_register_named("slots", vtable);
    if (data[0]) some();
}
