/* What needing.c needs, and a topic hook that refuses the topic /refused. */
#include <stdint.h>
#include <string.h>
int orb_publish(int topic) { return topic; }
int32_t know_topic(const char *topic, const char *type) { return type && !strcmp(topic, "/refused") ? -7 : 0; }
