/* A library, but no backend. */
int something(void) { return 1; }
