"""The C boundary of nano-ros as ctypes types: layout of nano-ros 0.5.0 (commit 9a7a150), LP64.

Facts about the layout, not lines of its headers. `LAYOUT` and `SLOTS` are what `layout` compares an
author's headers with.
"""

from __future__ import annotations

import ctypes as ct
from collections.abc import Mapping

SPEAKS = "nano-ros 0.5.0 (9a7a150)"
"""The headers that this adapter was written for."""

_UINT8, _UINT16, _UINT32, _INT16, _INT32 = ct.c_uint8, ct.c_uint16, ct.c_uint32, ct.c_int16, ct.c_int32


class Qos(ct.Structure):
    """``nros_rmw_qos_t``."""

    _fields_ = (
        ("reliability", _UINT8),
        ("durability", _UINT8),
        ("history", _UINT8),
        ("liveliness_kind", _UINT8),
        ("depth", _UINT16),
        ("_reserved0", _UINT16),
        ("deadline_ms", _UINT32),
        ("lifespan_ms", _UINT32),
        ("liveliness_lease_ms", _UINT32),
        ("avoid_ros_namespace_conventions", _UINT8),
        ("_reserved1", _UINT8 * 3),
    )


class SessionStruct(ct.Structure):
    """``nros_rmw_session_t``."""

    _fields_ = (
        ("node_name", ct.c_void_p),
        ("namespace_", ct.c_void_p),
        ("_reserved", _UINT8 * 8),
        ("backend_data", ct.c_void_p),
    )


class EntityStruct(ct.Structure):
    """``nros_rmw_publisher_t`` and ``nros_rmw_subscription_t``, which have the same fields."""

    _fields_ = (
        ("topic_name", ct.c_void_p),
        ("type_name", ct.c_void_p),
        ("qos", Qos),
        ("can_loan_messages", ct.c_bool),
        ("_reserved", _UINT8 * 7),
        ("backend_data", ct.c_void_p),
    )


class ServiceStruct(ct.Structure):
    """``nros_rmw_service_t`` and ``nros_rmw_client_t``."""

    _fields_ = (
        ("service_name", ct.c_void_p),
        ("type_name", ct.c_void_p),
        ("_reserved", _UINT8 * 8),
        ("backend_data", ct.c_void_p),
    )


class PublisherOptions(ct.Structure):
    """``nros_rmw_publisher_options_t``."""

    _fields_ = (("tx_express", _UINT8), ("_reserved", _UINT8 * 7))


class SubscriptionOptions(ct.Structure):
    """``nros_rmw_subscription_options_t``."""

    _fields_ = (("rx_buffer_hint", _UINT32), ("_reserved", _UINT8 * 4))


class LivelinessPayload(ct.Structure):
    """``nros_rmw_liveliness_changed_status_t``."""

    _fields_ = (
        ("alive_count", _UINT16),
        ("not_alive_count", _UINT16),
        ("alive_count_change", _INT16),
        ("not_alive_count_change", _INT16),
    )


class CountPayload(ct.Structure):
    """``nros_rmw_count_status_t``."""

    _fields_ = (("total_count", _UINT32), ("total_count_change", _UINT32))


EventFunction = ct.CFUNCTYPE(None, _INT32, ct.c_void_p, ct.c_void_p)
"""``nros_rmw_event_callback_t``: kind, payload, user context."""

_NAME, _HANDLE, _DATA = ct.c_char_p, ct.c_void_p, ct.c_void_p
_CREATE = ct.CFUNCTYPE(
    _INT32, _HANDLE, ct.c_void_p, ct.c_void_p, _NAME, _UINT32, ct.c_void_p, ct.c_void_p, _HANDLE
)  # fmt: skip
_REGISTER = ct.CFUNCTYPE(_INT32, _HANDLE, _INT32, _UINT32, EventFunction, ct.c_void_p)
_GONE = ct.CFUNCTYPE(None, _HANDLE)
_ASK = ct.CFUNCTYPE(_INT32, _HANDLE)
_TIMED = ct.CFUNCTYPE(_INT32, _HANDLE, _INT32)
_BYTES = ct.CFUNCTYPE(_INT32, _HANDLE, _DATA, ct.c_size_t)

PROTOTYPES: Mapping[str, type[ct._CFunctionType]] = {
    "create_session": ct.CFUNCTYPE(_INT32, _NAME, _UINT8, _UINT32, ct.c_void_p, _HANDLE),
    "destroy_session": _ASK,
    "drive_io": _TIMED,
    "create_publisher": _CREATE,
    "destroy_publisher": _GONE,
    "publish_raw": _BYTES,
    "create_subscription": _CREATE,
    "destroy_subscription": _GONE,
    "try_recv_raw": _BYTES,
    "has_data": _ASK,
    "register_subscription_event": _REGISTER,
    "register_publisher_event": _REGISTER,
    "assert_publisher_liveliness": _ASK,
    "ping_session": _TIMED,
}
"""The slots that the suites call. All of them give the GIL away: they may wait, and call back."""

SLOTS = (
    "create_session", "destroy_session", "drive_io", "create_publisher", "destroy_publisher", "publish_raw",
    "create_subscription", "destroy_subscription", "try_recv_raw", "has_data", "create_service", "destroy_service",
    "try_recv_request", "has_request", "send_reply", "create_client", "destroy_client", "send_request_raw",
    "try_recv_reply_raw", "register_subscription_event", "register_publisher_event", "assert_publisher_liveliness",
    "next_deadline_ms", "set_wake_callback", "pub_loan", "pub_commit", "pub_discard", "sub_borrow", "sub_release",
    "service_server_available", "try_recv_sequence", "publish_streamed", "ping_session",
    "subscription_supports_in_place", "process_raw_in_place",
)  # fmt: skip
"""``nros_rmw_vtable_t``: its order is the ABI."""

MANDATORY = SLOTS[:17]
POINTER = ct.sizeof(ct.c_void_p)
VTABLE_SIZE = len(SLOTS) * POINTER


def _offsets(struct: type[ct.Structure]) -> dict[str, int]:
    fields = [field[0] for field in struct._fields_]
    return {name: getattr(struct, name).offset for name in fields if not name.startswith("_")}


STRUCTS: Mapping[str, type[ct.Structure]] = {
    "nros_rmw_qos_t": Qos,
    "nros_rmw_session_t": SessionStruct,
    "nros_rmw_publisher_t": EntityStruct,
    "nros_rmw_subscription_t": EntityStruct,
    "nros_rmw_service_t": ServiceStruct,
    "nros_rmw_client_t": ServiceStruct,
    "nros_rmw_publisher_options_t": PublisherOptions,
    "nros_rmw_subscription_options_t": SubscriptionOptions,
    "nros_rmw_liveliness_changed_status_t": LivelinessPayload,
    "nros_rmw_count_status_t": CountPayload,
}

LAYOUT: Mapping[str, tuple[int, Mapping[str, int]]] = {
    **{name: (ct.sizeof(struct), _offsets(struct)) for name, struct in STRUCTS.items()},
    "nros_rmw_vtable_t": (VTABLE_SIZE, {name: POINTER * index for index, name in enumerate(SLOTS)}),
}
"""Of every struct: its size, and the offset of every field that is not reserved."""
