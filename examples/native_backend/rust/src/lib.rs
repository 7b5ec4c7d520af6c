//! The C example again, for authors who write Rust: a bus inside the process with all five status events.
//!
//! `backend_data` is a number, not a pointer, so a stale handle finds nothing instead of freed memory. The
//! lock is never held while a callback runs. A panic does not cross the boundary: Rust aborts the process,
//! which a conformance run shows as a crash, with the line that panicked in its log.

mod abi;

use abi::*;
use std::collections::{BTreeMap, VecDeque};
use std::ffi::{c_char, c_void, CStr};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

const LARGEST: usize = 1 << 20;
const KEPT: usize = 8192;

struct Sample {
    expires: Option<Instant>,
    history: bool, // from before the subscription: dropping it is no loss
    data: Vec<u8>,
}

const LIVELINESS_CHANGED: usize = 0;
const REQUESTED_MISSED: usize = 1;
const MESSAGE_LOST: usize = 2;
const LIVELINESS_LOST: usize = 3;
const OFFERED_MISSED: usize = 4;

struct Node {
    domain: u32,
    name: String,
    driving: bool,
    news: bool, // a sample came: the application may want to take it
    turn: u64,
}

#[derive(Clone, Copy, Default)]
struct Event {
    call: Option<Callback>,
    context: usize,
    total: u32, // what has occurred,
    told: u32,  // and what of it has been told
    turn: u64,  // in which it was called last
}

struct End {
    session: usize,
    publishes: bool,
    topic: String,
    type_name: String,
    qos: Qos,
    samples: VecDeque<Sample>, // the queue of a subscription, the history of a publisher
    events: [Event; 5],
    period: Option<Duration>,
    anchor: Option<Instant>, // the deadline is not armed before the first sample
    counted: u32,
    asserted: Instant,
    alive: bool,
    counts: (i32, i32), // of a subscription: alive, not alive,
    told: (i32, i32),   // and what of it has been told
}

#[derive(Default)]
struct Bus {
    last: usize,
    sessions: BTreeMap<usize, Node>,
    ends: BTreeMap<usize, End>,
}

static BUS: Mutex<Bus> = Mutex::new(Bus { last: 0, sessions: BTreeMap::new(), ends: BTreeMap::new() });
static CHANGED: Condvar = Condvar::new();

fn bus() -> MutexGuard<'static, Bus> {
    BUS.lock().unwrap_or_else(PoisonError::into_inner)
}

fn period(ms: u32) -> Option<Duration> {
    (ms != 0 && ms != u32::MAX).then(|| Duration::from_millis(ms.into()))
}

/// Nothing asked for that is not offered; without a period anything is.
fn within(offered: u32, asked: u32) -> bool {
    period(offered).unwrap_or(Duration::MAX) <= period(asked).unwrap_or(Duration::MAX)
}

impl End {
    fn miss_due(&self) -> Option<Instant> {
        Some(self.anchor? + self.period? * (self.counted + 1))
    }

    fn lease_due(&self) -> Option<Instant> {
        let runs = self.publishes && self.alive && self.qos.liveliness >= 2;
        if runs {
            Some(self.asserted + period(self.qos.lease_ms)?)
        } else {
            None
        }
    }

    fn append(&mut self, sample: Sample) {
        let depth = usize::from(self.qos.depth.max(1));
        self.samples.push_back(sample);
        if self.samples.len() > if self.qos.history == 1 { KEPT } else { depth } {
            let lost = self.samples.pop_front().is_some_and(|gone| !gone.history);
            self.events[MESSAGE_LOST].total += u32::from(lost);
        }
    }

    fn expire(&mut self, now: Instant) {
        self.samples.retain(|sample| sample.expires.is_none_or(|at| at > now));
    }

    fn restart(&mut self, now: Instant) {
        (self.anchor, self.counted) = (Some(now), 0);
    }

    /// What there is to tell of this event, which counts as told.
    fn take_news(&mut self, kind: usize) -> Option<Payload> {
        if kind == LIVELINESS_CHANGED {
            let ((alive, not_alive), told) = (self.counts, std::mem::replace(&mut self.told, self.counts));
            let change = ((alive - told.0) as i16, (not_alive - told.1) as i16);
            return (change != (0, 0)).then_some(Payload {
                liveliness: LivelinessChanged {
                    alive: alive as u16,
                    not_alive: not_alive as u16,
                    alive_change: change.0,
                    not_alive_change: change.1,
                },
            });
        }
        let event = &mut self.events[kind];
        let change = event.total - std::mem::replace(&mut event.told, event.total);
        (change != 0).then_some(Payload { count: Count { total: event.total, change } })
    }
}

impl Bus {
    fn matched(&self, p: &End, s: &End) -> bool {
        let domain = |end: &End| self.sessions.get(&end.session).map(|node| node.domain);
        p.publishes
            && !s.publishes
            && domain(p) == domain(s)
            && p.topic == s.topic
            && p.type_name == s.type_name
            && p.qos.reliability >= s.qos.reliability
            && p.qos.durability >= s.qos.durability
            && p.qos.liveliness.max(1) >= s.qos.liveliness
            && within(p.qos.deadline_ms, s.qos.deadline_ms)
            && within(p.qos.lease_ms, s.qos.lease_ms)
    }

    /// The subscriptions of a publisher.
    fn readers(&self, publisher: usize) -> Vec<usize> {
        let p = &self.ends[&publisher];
        self.ends.iter().filter(|(_, s)| self.matched(p, s)).map(|(id, _)| *id).collect()
    }

    fn count_as(&mut self, publisher: usize, alive: i32, not_alive: i32) {
        for id in self.readers(publisher) {
            let counts = &mut self.ends.get_mut(&id).expect("a reader").counts;
            *counts = (counts.0 + alive, counts.1 + not_alive);
        }
    }

    /// Count every deadline and lease that has run out by `now`; when the next one does.
    fn advance(&mut self, now: Instant) -> Option<Instant> {
        let mut lost = Vec::new();
        for (id, end) in &mut self.ends {
            let kind = if end.publishes { OFFERED_MISSED } else { REQUESTED_MISSED };
            if end.miss_due().is_some_and(|due| due <= now) {
                let (anchor, period) = (end.anchor.unwrap_or(now), end.period.unwrap_or(Duration::MAX));
                let elapsed = ((now - anchor).as_nanos() / period.as_nanos()) as u32;
                end.events[kind].total += elapsed - end.counted;
                end.counted = elapsed;
            }
            if end.lease_due().is_some_and(|due| due <= now) {
                end.alive = false;
                end.events[LIVELINESS_LOST].total += 1;
                lost.push(*id);
            }
        }
        for id in lost {
            self.count_as(id, -1, 1);
        }
        self.ends.values().flat_map(|end| [end.miss_due(), end.lease_due()]).flatten().min()
    }

    fn assert_alive(&mut self, publisher: usize, now: Instant) {
        let p = &self.ends[&publisher];
        let node = |end: &End| self.sessions.get(&end.session).map(|node| (node.domain, node.name.clone()));
        let siblings =
            |end: &End| end.publishes && end.qos.liveliness == 3 && p.qos.liveliness == 3 && node(end) == node(p);
        let covered: Vec<usize> =
            self.ends.iter().filter(|(id, end)| **id == publisher || siblings(end)).map(|(id, _)| *id).collect();
        for id in covered {
            let end = self.ends.get_mut(&id).expect("a publisher");
            end.asserted = now;
            if !std::mem::replace(&mut end.alive, true) {
                self.count_as(id, 1, -1);
            }
        }
    }

    /// A callback of this session that has news and has not had its turn yet.
    fn ready(&mut self, session: usize) -> Option<(Callback, usize, Payload, usize)> {
        let turn = self.sessions.get(&session)?.turn;
        for end in self.ends.values_mut().filter(|end| end.session == session) {
            for kind in 0..5 {
                let (call, event) = (end.events[kind].call, end.events[kind]);
                if event.turn == turn || call.is_none() {
                    continue;
                }
                if let Some(payload) = end.take_news(kind) {
                    end.events[kind].turn = turn;
                    return Some((call?, kind, payload, event.context));
                }
            }
        }
        None
    }
}

/// The number behind a handle; 0 is none.
unsafe fn session_of(handle: *mut Session) -> usize {
    if handle.is_null() {
        0
    } else {
        (*handle).backend_data as usize
    }
}

unsafe fn end_of(handle: *mut Entity) -> usize {
    if handle.is_null() {
        0
    } else {
        (*handle).backend_data as usize
    }
}

unsafe fn text(text: *const c_char) -> Option<String> {
    if text.is_null() {
        None
    } else {
        Some(CStr::from_ptr(text).to_str().ok()?.to_owned())
    }
}

unsafe extern "C" fn create_session(
    _: *const c_char,
    _: u8,
    domain: u32,
    name: *const c_char,
    out: *mut Session,
) -> i32 {
    let (Some(name), false) = (text(name), out.is_null()) else { return INVALID_ARGUMENT };
    let mut bus = bus();
    bus.last += 1;
    let id = bus.last;
    bus.sessions.insert(id, Node { domain, name, driving: false, news: false, turn: 0 });
    (*out).backend_data = id as *mut c_void;
    OK
}

unsafe extern "C" fn destroy_session(handle: *mut Session) -> i32 {
    let (id, mut bus) = (session_of(handle), bus());
    let Some(node) = bus.sessions.get(&id) else { return INVALID_ARGUMENT };
    if node.driving {
        return WOULD_BLOCK;
    }
    if bus.ends.values().any(|end| end.session == id) {
        return ERROR; // its entities go first
    }
    bus.sessions.remove(&id);
    OK
}

unsafe extern "C" fn drive_io(handle: *mut Session, timeout_ms: i32) -> i32 {
    let (id, mut bus) = (session_of(handle), bus());
    let until = Instant::now() + Duration::from_millis(timeout_ms.max(0) as u64);
    let Some(node) = bus.sessions.get_mut(&id) else { return INVALID_ARGUMENT };
    if node.driving {
        return WOULD_BLOCK; // from inside a callback
    }
    (node.driving, node.turn) = (true, node.turn + 1);
    loop {
        let now = Instant::now();
        let due = bus.advance(now).unwrap_or(until).min(until);
        let mut called = false;
        while let Some((call, kind, payload, context)) = bus.ready(id) {
            drop(bus); // it may do as it likes, also destroy this very entity
            call(kind as i32, &payload, context as *mut c_void);
            bus = crate::bus();
            called = true;
        }
        if called || bus.sessions[&id].news || now >= until {
            break; // after the look: what is due is told
        }
        let left = due.saturating_duration_since(Instant::now());
        bus = CHANGED.wait_timeout(bus, left).unwrap_or_else(PoisonError::into_inner).0;
    }
    if let Some(node) = bus.sessions.get_mut(&id) {
        (node.driving, node.news) = (false, false);
    }
    OK
}

fn valid_name(name: &str) -> bool {
    name.strip_prefix('/').unwrap_or(name).split('/').all(|part| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    })
}

unsafe fn create(
    of: *mut Session,
    topic: *const c_char,
    type_name: *const c_char,
    qos: *const Qos,
    publishes: bool,
    out: *mut Entity,
) -> i32 {
    let session = session_of(of);
    let (Some(topic), Some(type_name), false, false) = (text(topic), text(type_name), qos.is_null(), out.is_null())
    else {
        return INVALID_ARGUMENT;
    };
    let (qos, now, mut bus) = (*qos, Instant::now(), bus());
    let Some(domain) = bus.sessions.get(&session).map(|node| node.domain) else { return INVALID_ARGUMENT };
    if qos.reliability > 1 || qos.durability > 1 || qos.history > 1 || qos.liveliness > 3 {
        return INVALID_ARGUMENT;
    }
    let other_type =
        |end: &End| bus.sessions[&end.session].domain == domain && end.topic == topic && end.type_name != type_name;
    if !valid_name(&topic) || type_name.is_empty() || bus.ends.values().any(other_type) {
        return TOPIC_NAME_INVALID;
    }
    bus.advance(now);
    let mut made = End {
        session,
        publishes,
        topic,
        type_name,
        qos,
        samples: VecDeque::new(),
        events: [Event::default(); 5],
        period: period(qos.deadline_ms),
        anchor: None,
        counted: 0,
        asserted: now,
        alive: true,
        counts: (0, 0),
        told: (0, 0),
    };
    let found: Vec<usize> = bus.ends.iter().filter(|(_, p)| bus.matched(p, &made)).map(|(id, _)| *id).collect();
    for id in found {
        let p = bus.ends.get_mut(&id).expect("a publisher"); // that existed before this subscription
        p.expire(now);
        if p.alive {
            made.counts.0 += 1
        } else {
            made.counts.1 += 1
        }
        for old in p.samples.iter().filter(|_| qos.durability == 1) {
            made.append(Sample { expires: old.expires, history: true, data: old.data.clone() });
        }
    }
    bus.last += 1;
    let id = bus.last;
    bus.ends.insert(id, made);
    bus.count_as(id, 1, 0);
    (*out).backend_data = id as *mut c_void;
    CHANGED.notify_all();
    OK
}

unsafe extern "C" fn create_publisher(
    of: *mut Session,
    topic: *const c_char,
    type_name: *const c_char,
    _: *const c_char,
    _: u32,
    qos: *const Qos,
    _: *const c_void,
    out: *mut Entity,
) -> i32 {
    create(of, topic, type_name, qos, true, out)
}

unsafe extern "C" fn create_subscription(
    of: *mut Session,
    topic: *const c_char,
    type_name: *const c_char,
    _: *const c_char,
    _: u32,
    qos: *const Qos,
    _: *const c_void,
    out: *mut Entity,
) -> i32 {
    create(of, topic, type_name, qos, false, out)
}

unsafe extern "C" fn destroy(handle: *mut Entity) {
    let (id, mut bus) = (end_of(handle), bus());
    bus.advance(Instant::now());
    if let Some(alive) = bus.ends.get(&id).map(|end| end.alive) {
        bus.count_as(id, -i32::from(alive), -i32::from(!alive));
        bus.ends.remove(&id);
    }
    CHANGED.notify_all();
}

unsafe extern "C" fn publish_raw(handle: *mut Entity, data: *const u8, len: usize) -> i32 {
    if cfg!(feature = "panics") {
        panic!("publish_raw was told to");
    }
    let (id, mut bus) = (end_of(handle), bus());
    if !bus.ends.contains_key(&id) || (data.is_null() && len > 0) {
        return INVALID_ARGUMENT;
    }
    if len > LARGEST {
        return MESSAGE_TOO_LARGE;
    }
    let now = Instant::now();
    let data = if len > 0 { std::slice::from_raw_parts(data, len).to_vec() } else { Vec::new() };
    bus.advance(now - Duration::from_nanos(1)); // at the very moment of a deadline is in time
    bus.assert_alive(id, now);
    let p = bus.ends.get_mut(&id).expect("looked up above");
    let expires = period(p.qos.lifespan_ms).map(|lifespan| now + lifespan);
    p.restart(now);
    if p.qos.durability == 1 {
        p.append(Sample { expires, history: true, data: data.clone() });
    }
    for reader in bus.readers(id) {
        let s = bus.ends.get_mut(&reader).expect("a reader");
        s.expire(now);
        s.restart(now);
        s.append(Sample { expires, history: false, data: data.clone() });
        let session = s.session;
        bus.sessions.get_mut(&session).expect("of a reader").news = true;
    }
    CHANGED.notify_all();
    OK
}

unsafe extern "C" fn has_data(handle: *mut Entity) -> i32 {
    let (id, mut bus) = (end_of(handle), bus());
    let Some(s) = bus.ends.get_mut(&id) else { return INVALID_ARGUMENT };
    s.expire(Instant::now());
    i32::from(!s.samples.is_empty())
}

unsafe extern "C" fn try_recv_raw(handle: *mut Entity, buf: *mut u8, room: usize) -> i32 {
    let (id, mut bus) = (end_of(handle), bus());
    let Some(s) = bus.ends.get_mut(&id) else { return INVALID_ARGUMENT };
    s.expire(Instant::now());
    let Some(sample) = s.samples.pop_front() else { return NO_DATA };
    if sample.data.len() > room || buf.is_null() {
        s.events[MESSAGE_LOST].total += 1; // it is gone, so it is accounted for
        return BUFFER_TOO_SMALL;
    }
    std::ptr::copy_nonoverlapping(sample.data.as_ptr(), buf, sample.data.len());
    sample.data.len() as i32
}

unsafe extern "C" fn register(
    handle: *mut Entity,
    kind: i32,
    deadline_ms: u32,
    call: Option<Callback>,
    context: *mut c_void,
) -> i32 {
    let (id, mut bus) = (end_of(handle), bus());
    let Some(end) = bus.ends.get_mut(&id) else { return INVALID_ARGUMENT };
    let kinds = if end.publishes { LIVELINESS_LOST..5 } else { 0..LIVELINESS_LOST };
    let Some(kind) = usize::try_from(kind).ok().filter(|kind| kinds.contains(kind)) else {
        return if cfg!(feature = "wrong_code") { ERROR } else { UNSUPPORTED };
    };
    if call.is_none() {
        return INVALID_ARGUMENT;
    }
    if kind == REQUESTED_MISSED || kind == OFFERED_MISSED {
        end.period = end.period.or(period(deadline_ms));
        if end.period.is_none() {
            return INCOMPATIBLE_QOS;
        }
    }
    (end.events[kind].call, end.events[kind].context) = (call, context as usize);
    CHANGED.notify_all();
    OK
}

unsafe extern "C" fn assert_liveliness(handle: *mut Entity) -> i32 {
    let (id, mut bus, now) = (end_of(handle), bus(), Instant::now());
    if !bus.ends.contains_key(&id) {
        return INVALID_ARGUMENT;
    }
    bus.advance(now - Duration::from_nanos(1));
    bus.assert_alive(id, now);
    CHANGED.notify_all();
    OK
}

// Services are refused, but their slots are not optional.
unsafe extern "C" fn no_service(
    _: *mut Session,
    _: *const c_char,
    _: *const c_char,
    _: *const c_char,
    _: u32,
    _: *const Qos,
    _: *mut Session,
) -> i32 {
    UNSUPPORTED
}
unsafe extern "C" fn no_service_gone(_: *mut Session) {}
unsafe extern "C" fn no_request(_: *mut Session, _: *mut u8, _: usize, _: *mut i64) -> i32 {
    UNSUPPORTED
}
unsafe extern "C" fn no_request_waits(_: *mut Session) -> i32 {
    UNSUPPORTED
}
unsafe extern "C" fn no_reply(_: *mut Session, _: i64, _: *const u8, _: usize) -> i32 {
    UNSUPPORTED
}
unsafe extern "C" fn no_request_sent(_: *mut Session, _: *const u8, _: usize) -> i32 {
    UNSUPPORTED
}
unsafe extern "C" fn no_reply_waits(_: *mut Session, _: *mut u8, _: usize) -> i32 {
    UNSUPPORTED
}

static VTABLE: Vtable = Vtable {
    create_session,
    destroy_session,
    drive_io,
    create_publisher,
    destroy_publisher: destroy,
    publish_raw,
    create_subscription,
    destroy_subscription: destroy,
    try_recv_raw,
    has_data,
    create_service: no_service,
    destroy_service: no_service_gone,
    try_recv_request: no_request,
    has_request: no_request_waits,
    send_reply: no_reply,
    create_client: no_service,
    destroy_client: no_service_gone,
    send_request_raw: no_request_sent,
    try_recv_reply_raw: no_reply_waits,
    register_subscription_event: Some(register),
    register_publisher_event: Some(register),
    assert_publisher_liveliness: Some(assert_liveliness),
    others: [None; 13],
};

/// Registered explicitly; nros-conformance calls it for `--name loopback_rs`.
#[no_mangle]
pub extern "C" fn nros_rmw_loopback_rs_register() -> i32 {
    unsafe { nros_rmw_cffi_register_named(c"loopback_rs".as_ptr(), &VTABLE) }
}
