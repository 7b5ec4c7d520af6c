/* What -DDEFECT=... may compile in; nros-conformance has to find each of them. */
enum {
    NONE,
    WRONG_CODE,                 /* answers ERROR where it ought to be UNSUPPORTED */
    FIRES_IN_REGISTER,          /* calls back from inside register */
    FIRES_IN_PUBLISH,           /* calls back from inside publish_raw */
    WRONG_THREAD,               /* calls back on a thread of its own */
    NEVER_RESETS_CHANGE,        /* reports the total as the change */
    ALIASES_KIND,               /* takes kind 256 for kind 0 */
    COUNTS_BEFORE_REGISTRATION, /* in the total, but not in the change */
    FIRES_AFTER_DESTROY,        /* of a subscription */
    KEEPS_STRUCT,               /* keeps a pointer to the runtime's struct */
    CRASHES_IN_CREATE,
    CRASHES_IN_PUBLISH
};
#ifndef DEFECT
#define DEFECT NONE
#endif
