/* A nano-ros backend in plain C: a bus inside the process, with all five status events.
 *
 * Sessions of one process meet on it when their domain is the same. Replace the bus by your middleware,
 * keep how events are counted and called. -DDEFECT=... compiles a defect in, which nros-conformance has to
 * find (see CMakeLists.txt): whoever copies this file deletes every line that names DEFECT. */
#define _GNU_SOURCE
#include <nros/rmw_vtable.h>
#include <pthread.h>
#include <regex.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "defects.h" /* DEFECT */

enum { LARGEST = 1 << 20, KEPT = 8192 }; /* bytes of a sample; samples that KEEP_ALL keeps */
#define MS 1000000LL
#define NEVER INT64_MAX
enum { LIVELINESS_CHANGED, REQUESTED_MISSED, MESSAGE_LOST, LIVELINESS_LOST, OFFERED_MISSED, KINDS };

typedef struct sample {
    struct sample *next;
    int64_t expires;
    bool history; /* from before the subscription: dropping it is no loss */
    size_t len;
    uint8_t data[];
} sample;
typedef struct session {
    uint32_t domain;
    char node[64];
    bool driving, news; /* news: a sample came, the application may want to take it */
    uint64_t turn;      /* drives so far */
} session;

typedef struct {
    nros_rmw_event_callback_t call;
    void *context;
    uint32_t total, told; /* what has occurred, and what of it has been told */
    uint64_t turn;        /* in which it was called last */
} event;

typedef struct endpoint {
    struct endpoint *next;
    session *session;
    bool publishes;
    const char *topic, *type; /* the runtime's; they live as long as the entity */
    nros_rmw_qos_t qos;
    sample *first; /* the queue of a subscription, the history of a publisher */
    size_t count;
    event events[KINDS];
    int64_t period, anchor, counted; /* the deadline, not armed before the first sample */
    bool alive;       /* of a publisher, */
    int64_t asserted; /* as is this; */
    int32_t is_alive, not_alive, told_alive, told_silent; /* and of a subscription */
    void *kept; /* DEFECT */
} endpoint;

/* One lock for everything. It is never held while a callback runs. */
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed;
static endpoint *endpoints;
static regex_t names;

static int64_t lock(void) {
    struct timespec t;
    pthread_mutex_lock(&mutex);
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000 * MS + t.tv_nsec;
}
static int32_t unlock(int32_t code) {
    pthread_mutex_unlock(&mutex);
    return code;
}
static int32_t wake(int32_t code) { /* whoever waits in drive_io, and unlock */
    pthread_cond_broadcast(&changed);
    return unlock(code);
}
/* ---- Events: what occurs, by the clock and by what publishers do --------------------------------- */
static bool finite(uint32_t ms) { return ms != 0 && ms != NROS_RMW_DURATION_INFINITE_MS; }
static int64_t period(uint32_t ms) { return finite(ms) ? ms * MS : NEVER; }

/* Same topic, and nothing asked for that is not offered. */
static bool matched(const endpoint *p, const endpoint *s) {
    uint8_t offered = p->qos.liveliness_kind ? p->qos.liveliness_kind : NROS_RMW_LIVELINESS_AUTOMATIC;
    return p->publishes && !s->publishes && p->session->domain == s->session->domain &&
           !strcmp(p->topic, s->topic) && !strcmp(p->type, s->type) && p->qos.reliability >= s->qos.reliability &&
           p->qos.durability >= s->qos.durability && offered >= s->qos.liveliness_kind &&
           period(p->qos.deadline_ms) <= period(s->qos.deadline_ms) &&
           period(p->qos.liveliness_lease_ms) <= period(s->qos.liveliness_lease_ms);
}

static void count_as(const endpoint *p, int alive, int not_alive) {
    for (endpoint *s = endpoints; s; s = s->next)
        if (matched(p, s)) s->is_alive += alive, s->not_alive += not_alive;
}

static int64_t miss_due(const endpoint *e) {
    return e->period && e->anchor ? e->anchor + (e->counted + 1) * e->period : NEVER;
}
static int64_t lease_due(const endpoint *e) {
    bool runs = e->publishes && e->alive && e->qos.liveliness_kind >= NROS_RMW_LIVELINESS_MANUAL_BY_TOPIC;
    return runs && finite(e->qos.liveliness_lease_ms) ? e->asserted + period(e->qos.liveliness_lease_ms) : NEVER;
}

/* Count every deadline and lease that has run out by `now`, however long nobody looked; when the next one does. */
static int64_t advance(int64_t now) {
    int64_t next = NEVER;
    for (endpoint *e = endpoints; e; e = e->next) {
        if (miss_due(e) <= now) {
            int64_t elapsed = (now - e->anchor) / e->period;
            e->events[e->publishes ? OFFERED_MISSED : REQUESTED_MISSED].total += (uint32_t)(elapsed - e->counted);
            e->counted = elapsed;
        }
        if (lease_due(e) <= now) {
            e->alive = false;
            e->events[LIVELINESS_LOST].total++;
            count_as(e, -1, 1);
        }
        next = miss_due(e) < next ? miss_due(e) : next;
        next = lease_due(e) < next ? lease_due(e) : next;
    }
    return next;
}

static void assert_alive(const endpoint *p, int64_t now) {
    bool by_node = p->qos.liveliness_kind == NROS_RMW_LIVELINESS_MANUAL_BY_NODE; /* covers its siblings */
    for (endpoint *o = endpoints; o; o = o->next) {
        bool sibling = o->publishes && by_node && o->qos.liveliness_kind == NROS_RMW_LIVELINESS_MANUAL_BY_NODE &&
                       o->session->domain == p->session->domain && !strcmp(o->session->node, p->session->node);
        if (o != p && !sibling) continue;
        o->asserted = now;
        if (!o->alive) count_as(o, 1, -1);
        o->alive = true;
    }
}

/* Whether this event has news; if so, what to tell, and it counts as told. */
static bool take_news(endpoint *e, int kind, nros_rmw_event_payload_t *tell) {
    event *v = &e->events[kind];
    if (kind == LIVELINESS_CHANGED) {
        int32_t more = e->is_alive - e->told_alive, silent = e->not_alive - e->told_silent;
        tell->liveliness_changed = (nros_rmw_liveliness_changed_status_t){e->is_alive, e->not_alive, more, silent};
        e->told_alive = e->is_alive, e->told_silent = e->not_alive;
        return more || silent;
    }
    uint32_t change = v->total - v->told;
    tell->count = (nros_rmw_count_status_t){v->total, DEFECT == NEVER_RESETS_CHANGE ? v->total : change};
    v->told = v->total;
    return change != 0;
}

/* ---- Driving: the only place where callbacks run -------------------------------------------------- */
/* Call every callback of this session that has news, each once a turn, without the lock. NULL: there was none. */
static void *call_all(void *of) {
    void *called = NULL;
    for (endpoint *e = endpoints; e; e = e->next)
        for (int kind = 0; kind < KINDS && e->session == of; kind++) {
            event v = e->events[kind];
            nros_rmw_event_payload_t tell;
            if (!v.call || v.turn == e->session->turn || !take_news(e, kind, &tell)) continue;
            e->events[kind].turn = e->session->turn;
            unlock(0); /* it may do as it likes, also destroy this very entity: so from the start again */
            v.call((nros_rmw_event_kind_t)kind, &tell, v.context);
            lock();
            called = of, kind = -1;
            if (!(e = endpoints)) return called;
        }
    return called;
}

static nros_rmw_ret_t drive_io(nros_rmw_session_t *handle, int32_t timeout_ms) {
    session *s = handle ? handle->backend_data : NULL;
    if (!s) return NROS_RMW_RET_INVALID_ARGUMENT;
    int64_t now = lock(), until = now + (timeout_ms > 0 ? timeout_ms : 0) * MS;
    if (s->driving) return unlock(NROS_RMW_RET_WOULD_BLOCK); /* from inside a callback */
    s->driving = true;
    s->turn++;
    for (void *called = NULL;;) {
        int64_t due = advance(now);
        pthread_t helper; /* DEFECT */
        if (DEFECT == WRONG_THREAD) pthread_create(&helper, NULL, call_all, s), pthread_join(helper, &called);
        else called = call_all(s);
        if (called || s->news || now >= until) break; /* after the look: what is due is told */
        due = due < until ? due : until;
        pthread_cond_timedwait(&changed, &mutex, &(struct timespec){due / (1000 * MS), due % (1000 * MS)});
        now = (unlock(0), lock());
    }
    s->news = s->driving = false;
    return unlock(NROS_RMW_RET_OK);
}

/* ---- Samples --------------------------------------------------------------------------------------- */
static void drop(endpoint *e, sample **one) {
    sample *gone = *one;
    *one = gone->next;
    e->count--;
    free(gone);
}

static void expire(endpoint *e, int64_t now) { /* what is over is gone, but not lost */
    for (sample **one = &e->first; *one;)
        if ((*one)->expires > now) one = &(*one)->next;
        else drop(e, one);
}

static bool append(endpoint *e, const uint8_t *data, size_t len, int64_t expires, bool history) {
    sample *made = malloc(sizeof *made + len), **end = &e->first;
    if (!made) return false;
    *made = (sample){.expires = expires, .history = history, .len = len};
    if (len) memcpy(made->data, data, len);
    while (*end) end = &(*end)->next;
    *end = made;
    size_t room = e->qos.history == NROS_RMW_HISTORY_KEEP_ALL ? KEPT : e->qos.depth ? e->qos.depth : 1;
    if (++e->count > room) {
        if (!e->first->history) e->events[MESSAGE_LOST].total++;
        drop(e, &e->first);
    }
    return true;
}

static nros_rmw_ret_t publish_raw(nros_rmw_publisher_t *handle, const uint8_t *data, size_t len) {
    endpoint *p = handle ? handle->backend_data : NULL;
    if (DEFECT == KEEPS_STRUCT) p = ((nros_rmw_publisher_t *)p->kept)->backend_data;
    if (DEFECT == CRASHES_IN_PUBLISH) p = *(void *volatile *)(uintptr_t)8;
    if (!p || (!data && len)) return NROS_RMW_RET_INVALID_ARGUMENT;
    if (len > LARGEST) return NROS_RMW_RET_MESSAGE_TOO_LARGE;
    int64_t now = lock(), expires = finite(p->qos.lifespan_ms) ? now + period(p->qos.lifespan_ms) : NEVER;
    advance(now - 1); /* at the very moment of a deadline is in time */
    assert_alive(p, now);
    p->anchor = now, p->counted = 0;
    bool kept = !p->qos.durability || append(p, data, len, expires, true);
    for (endpoint *s = endpoints; s; s = s->next) {
        if (!matched(p, s)) continue;
        expire(s, now);
        s->anchor = now, s->counted = 0;
        if (!append(s, data, len, expires, false)) s->events[MESSAGE_LOST].total++;
        s->session->news = true;
    }
    for (endpoint *s = endpoints; DEFECT == FIRES_IN_PUBLISH && s; s = s->next) s->session->turn++, call_all(s->session);
    return wake(kept ? NROS_RMW_RET_OK : NROS_RMW_RET_BAD_ALLOC);
}

static int32_t has_data(nros_rmw_subscription_t *handle) {
    endpoint *s = handle ? handle->backend_data : NULL;
    if (!s) return NROS_RMW_RET_INVALID_ARGUMENT;
    expire(s, lock());
    return unlock(s->first != NULL);
}

static int32_t try_recv_raw(nros_rmw_subscription_t *handle, uint8_t *buf, size_t buf_len) {
    endpoint *s = handle ? handle->backend_data : NULL;
    if (!s || (!buf && buf_len)) return NROS_RMW_RET_INVALID_ARGUMENT;
    expire(s, lock());
    if (!s->first) return unlock(NROS_RMW_RET_NO_DATA);
    size_t len = s->first->len;
    if (len && len <= buf_len) memcpy(buf, s->first->data, len);
    if (len > buf_len) s->events[MESSAGE_LOST].total++; /* it is gone, so it is accounted for */
    drop(s, &s->first);
    return unlock(len > buf_len ? NROS_RMW_RET_BUFFER_TOO_SMALL : (int32_t)len);
}

/* ---- Creating and destroying ----------------------------------------------------------------------- */
static nros_rmw_ret_t create(nros_rmw_session_t *of, const char *topic, const char *type, const nros_rmw_qos_t *qos,
                             bool publishes, void **out) {
    session *s = of ? of->backend_data : NULL;
    if (!s || !topic || !type || !qos || !out || qos->reliability > 1 || qos->durability > 1 || qos->history > 1 ||
        qos->liveliness_kind > NROS_RMW_LIVELINESS_MANUAL_BY_NODE)
        return NROS_RMW_RET_INVALID_ARGUMENT;
    if (regexec(&names, topic, 0, NULL, 0) || !*type) return NROS_RMW_RET_TOPIC_NAME_INVALID;
    endpoint *made = malloc(sizeof *made);
    if (!made) return NROS_RMW_RET_BAD_ALLOC;
    int64_t now = lock(); /* creation counts as the first assertion */
    *made = (endpoint){.session = s, .publishes = publishes, .topic = topic, .type = type, .qos = *qos, .alive = true,
                       .asserted = now, .period = finite(qos->deadline_ms) ? period(qos->deadline_ms) : 0};
    for (endpoint *o = endpoints; o; o = o->next)
        if (o->session->domain == s->domain && !strcmp(o->topic, topic) && strcmp(o->type, type)) {
            free(made);
            return unlock(NROS_RMW_RET_TOPIC_NAME_INVALID); /* in use with another type */
        }
    advance(now);
    if (publishes) count_as(made, 1, 0);
    for (endpoint *p = endpoints; p; p = p->next) { /* a subscription finds the publishers that exist */
        if (!matched(p, made)) continue;
        *(p->alive ? &made->is_alive : &made->not_alive) += 1;
        expire(p, now);
        for (sample *h = qos->durability ? p->first : NULL; h; h = h->next)
            append(made, h->data, h->len, h->expires, true);
    }
    made->next = endpoints;
    *out = endpoints = made;
    return wake(NROS_RMW_RET_OK);
}

static nros_rmw_ret_t create_publisher(nros_rmw_session_t *of, const char *topic, const char *type, const char *hash,
                                       uint32_t domain, const nros_rmw_qos_t *qos,
                                       const nros_rmw_publisher_options_t *options, nros_rmw_publisher_t *out) {
    nros_rmw_ret_t code = create(of, topic, type, qos, true, out ? &out->backend_data : NULL);
    if (DEFECT == KEEPS_STRUCT && code == NROS_RMW_RET_OK) ((endpoint *)out->backend_data)->kept = out;
    return code;
}
static nros_rmw_ret_t create_subscription(nros_rmw_session_t *of, const char *topic, const char *type,
                                          const char *hash, uint32_t domain, const nros_rmw_qos_t *qos,
                                          const nros_rmw_subscription_options_t *options,
                                          nros_rmw_subscription_t *out) {
    return create(of, topic, type, qos, false, out ? &out->backend_data : NULL);
}

static void destroy(endpoint *e) { /* after this nothing of it runs any more */
    if (!e || (DEFECT == FIRES_AFTER_DESTROY && !e->publishes)) return;
    advance(lock());
    if (e->publishes) count_as(e, e->alive ? -1 : 0, e->alive ? 0 : -1);
    endpoint **one = &endpoints;
    while (*one != e) one = &(*one)->next;
    *one = e->next;
    while (e->first) drop(e, &e->first);
    free(e);
    wake(0);
}

static void destroy_publisher(nros_rmw_publisher_t *handle) { destroy(handle ? handle->backend_data : NULL); }
static void destroy_subscription(nros_rmw_subscription_t *handle) { destroy(handle ? handle->backend_data : NULL); }

static nros_rmw_ret_t create_session(const char *locator, uint8_t mode, uint32_t domain, const char *node,
                                     nros_rmw_session_t *out) {
    if (DEFECT == CRASHES_IN_CREATE) abort();
    session *s = node && out ? out->backend_data = calloc(1, sizeof *s) : NULL;
    if (!s) return node && out ? NROS_RMW_RET_BAD_ALLOC : NROS_RMW_RET_INVALID_ARGUMENT;
    s->domain = domain;
    strncpy(s->node, node, sizeof s->node - 1);
    return NROS_RMW_RET_OK;
}

static nros_rmw_ret_t destroy_session(nros_rmw_session_t *handle) {
    session *s = handle ? handle->backend_data : NULL;
    if (!s) return NROS_RMW_RET_INVALID_ARGUMENT;
    lock();
    if (s->driving) return unlock(NROS_RMW_RET_WOULD_BLOCK);
    for (endpoint *e = endpoints; e; e = e->next)
        if (e->session == s) return unlock(NROS_RMW_RET_ERROR); /* its entities go first */
    free(s);
    return unlock(NROS_RMW_RET_OK);
}

/* ---- Registering and asserting ---------------------------------------------------------------------- */
static nros_rmw_ret_t listen(endpoint *e, int kind, uint32_t deadline_ms, nros_rmw_event_callback_t cb, void *context) {
    if (DEFECT == ALIASES_KIND) kind &= 0xff;
    if (!e) return NROS_RMW_RET_INVALID_ARGUMENT;
    if (kind < 0 || kind >= KINDS || (kind >= LIVELINESS_LOST) != e->publishes)
        return DEFECT == WRONG_CODE ? NROS_RMW_RET_ERROR : NROS_RMW_RET_UNSUPPORTED;
    if (!cb) return NROS_RMW_RET_INVALID_ARGUMENT;
    lock();
    bool deadline = kind == REQUESTED_MISSED || kind == OFFERED_MISSED;
    if (deadline && !e->period && finite(deadline_ms)) e->period = period(deadline_ms);
    if (deadline && !e->period) return unlock(NROS_RMW_RET_INCOMPATIBLE_QOS);
    e->events[kind].call = cb, e->events[kind].context = context;
    if (DEFECT == COUNTS_BEFORE_REGISTRATION) e->events[kind].told = e->events[kind].total;
    if (DEFECT == FIRES_IN_REGISTER) e->session->turn++, call_all(e->session);
    return wake(NROS_RMW_RET_OK);
}

static nros_rmw_ret_t register_subscription_event(nros_rmw_subscription_t *handle, nros_rmw_event_kind_t kind,
                                                  uint32_t deadline_ms, nros_rmw_event_callback_t cb, void *context) {
    return listen(handle ? handle->backend_data : NULL, (int)kind, deadline_ms, cb, context);
}
static nros_rmw_ret_t register_publisher_event(nros_rmw_publisher_t *handle, nros_rmw_event_kind_t kind,
                                               uint32_t deadline_ms, nros_rmw_event_callback_t cb, void *context) {
    return listen(handle ? handle->backend_data : NULL, (int)kind, deadline_ms, cb, context);
}

static nros_rmw_ret_t assert_publisher_liveliness(nros_rmw_publisher_t *handle) {
    endpoint *p = handle ? handle->backend_data : NULL;
    if (!p) return NROS_RMW_RET_INVALID_ARGUMENT;
    int64_t now = lock();
    advance(now - 1);
    assert_alive(p, now);
    return wake(NROS_RMW_RET_OK);
}

/* ---- The vtable ------------------------------------------------------------------------------------- */
#include "services.h" /* refused, but their slots may not be NULL */

static const nros_rmw_vtable_t loopback_vtable = {
    .create_session = create_session, .destroy_session = destroy_session, .drive_io = drive_io,
    .create_publisher = create_publisher, .destroy_publisher = destroy_publisher, .publish_raw = publish_raw,
    .create_subscription = create_subscription, .destroy_subscription = destroy_subscription,
    .try_recv_raw = try_recv_raw, .has_data = has_data, SERVICES_REFUSED,
    .register_subscription_event = register_subscription_event,
    .register_publisher_event = register_publisher_event,
    .assert_publisher_liveliness = assert_publisher_liveliness,
};

__attribute__((constructor)) static void register_loopback(void) {
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC); /* the wall clock may be stepped */
    pthread_cond_init(&changed, &monotonic);
    regcomp(&names, "^/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$", REG_EXTENDED | REG_NOSUB);
    nros_rmw_cffi_register_named("loopback", &loopback_vtable);
}
