//! The C boundary of nano-ros 0.5.0 as far as this example needs it: a backend of yours uses nano-ros' own crate.
#![allow(dead_code)]

use std::ffi::{c_char, c_void};

pub const OK: i32 = 0;
pub const ERROR: i32 = -1;
pub const INVALID_ARGUMENT: i32 = -4;
pub const UNSUPPORTED: i32 = -5;
pub const INCOMPATIBLE_QOS: i32 = -6;
pub const TOPIC_NAME_INVALID: i32 = -7;
pub const NO_DATA: i32 = -10;
pub const WOULD_BLOCK: i32 = -11;
pub const BUFFER_TOO_SMALL: i32 = -12;
pub const MESSAGE_TOO_LARGE: i32 = -13;

#[repr(C)]
#[derive(Clone, Copy)]
pub struct Qos {
    pub reliability: u8,
    pub durability: u8,
    pub history: u8,
    pub liveliness: u8,
    pub depth: u16,
    reserved0: u16,
    pub deadline_ms: u32,
    pub lifespan_ms: u32,
    pub lease_ms: u32,
    pub avoid_ros_namespace_conventions: u8,
    reserved1: [u8; 3],
}

/// Sessions, services and clients look alike.
#[repr(C)]
pub struct Session {
    name: *const c_char,
    second_name: *const c_char,
    reserved: [u8; 8],
    pub backend_data: *mut c_void,
}

/// Publishers and subscriptions look alike.
#[repr(C)]
pub struct Entity {
    topic_name: *const c_char,
    type_name: *const c_char,
    qos: Qos,
    can_loan_messages: bool,
    reserved: [u8; 7],
    pub backend_data: *mut c_void,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct LivelinessChanged {
    pub alive: u16,
    pub not_alive: u16,
    pub alive_change: i16,
    pub not_alive_change: i16,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct Count {
    pub total: u32,
    pub change: u32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub union Payload {
    pub liveliness: LivelinessChanged,
    pub count: Count,
}

pub type Callback = unsafe extern "C" fn(kind: i32, payload: *const Payload, context: *mut c_void);
pub type Create = unsafe extern "C" fn(
    *mut Session,
    *const c_char,
    *const c_char,
    *const c_char,
    u32,
    *const Qos,
    *const c_void,
    *mut Entity,
) -> i32;
pub type CreateService = unsafe extern "C" fn(
    *mut Session,
    *const c_char,
    *const c_char,
    *const c_char,
    u32,
    *const Qos,
    *mut Session,
) -> i32;
pub type Register = unsafe extern "C" fn(*mut Entity, i32, u32, Option<Callback>, *mut c_void) -> i32;

/// The order of the slots is the ABI.
#[repr(C)]
pub struct Vtable {
    pub create_session: unsafe extern "C" fn(*const c_char, u8, u32, *const c_char, *mut Session) -> i32,
    pub destroy_session: unsafe extern "C" fn(*mut Session) -> i32,
    pub drive_io: unsafe extern "C" fn(*mut Session, i32) -> i32,
    pub create_publisher: Create,
    pub destroy_publisher: unsafe extern "C" fn(*mut Entity),
    pub publish_raw: unsafe extern "C" fn(*mut Entity, *const u8, usize) -> i32,
    pub create_subscription: Create,
    pub destroy_subscription: unsafe extern "C" fn(*mut Entity),
    pub try_recv_raw: unsafe extern "C" fn(*mut Entity, *mut u8, usize) -> i32,
    pub has_data: unsafe extern "C" fn(*mut Entity) -> i32,
    pub create_service: CreateService,
    pub destroy_service: unsafe extern "C" fn(*mut Session),
    pub try_recv_request: unsafe extern "C" fn(*mut Session, *mut u8, usize, *mut i64) -> i32,
    pub has_request: unsafe extern "C" fn(*mut Session) -> i32,
    pub send_reply: unsafe extern "C" fn(*mut Session, i64, *const u8, usize) -> i32,
    pub create_client: CreateService,
    pub destroy_client: unsafe extern "C" fn(*mut Session),
    pub send_request_raw: unsafe extern "C" fn(*mut Session, *const u8, usize) -> i32,
    pub try_recv_reply_raw: unsafe extern "C" fn(*mut Session, *mut u8, usize) -> i32,
    pub register_subscription_event: Option<Register>,
    pub register_publisher_event: Option<Register>,
    pub assert_publisher_liveliness: Option<unsafe extern "C" fn(*mut Entity) -> i32>,
    /// From next_deadline_ms to process_raw_in_place: all optional, none used here.
    pub others: [Option<unsafe extern "C" fn()>; 13],
}

extern "C" {
    /// Provided by the runtime (here: by nros-conformance). Names have at most 31 bytes.
    pub fn nros_rmw_cffi_register_named(name: *const c_char, vtable: *const Vtable) -> i32;
}
