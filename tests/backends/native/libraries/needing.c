/* Needs a symbol of a host library. */
int orb_publish(int topic);
int something(void) { return orb_publish(1); }
