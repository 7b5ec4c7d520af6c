"""Calls of Cyclone DDS that its Python binding lacks, or makes while it holds the GIL."""

from __future__ import annotations

import ctypes as ct
from collections.abc import Iterator
from typing import Any

from cyclonedds.builtin import BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import DDSException
from cyclonedds.internal import DDS, dds_c_t
from cyclonedds.topic import Sample

from nros_conformance.rmw.codes import ReturnCode

_FOR_EVER = 2**63 - 1
_BATCH = 64

_CODES = {
    DDSException.DDS_RETCODE_OK: ReturnCode.OK,
    DDSException.DDS_RETCODE_UNSUPPORTED: ReturnCode.UNSUPPORTED,
    DDSException.DDS_RETCODE_BAD_PARAMETER: ReturnCode.INVALID_ARGUMENT,
    DDSException.DDS_RETCODE_ALREADY_DELETED: ReturnCode.INVALID_ARGUMENT,
    DDSException.DDS_RETCODE_OUT_OF_RESOURCES: ReturnCode.BAD_ALLOC,
    DDSException.DDS_RETCODE_TIMEOUT: ReturnCode.TIMEOUT,
}


def return_code(dds_code: int) -> ReturnCode:
    """The contract's code for one of DDS; ERROR for those that it does not know."""
    return _CODES.get(dds_code, ReturnCode.ERROR)


class _Endpoint(ct.Structure):
    """``dds_builtintopic_endpoint_t``."""

    _fields_ = (
        ("key", ct.c_uint8 * 16),
        ("participant_key", ct.c_uint8 * 16),
        ("participant_instance_handle", ct.c_uint64),
        ("topic_name", ct.c_char_p),
        ("type_name", ct.c_char_p),
        ("qos", ct.c_void_p),
    )


class Native:
    """The C library, through a handle of its own: the prototypes set here reach nobody else's."""

    def __init__(self) -> None:
        library = ct.CDLL(DDS._dll_handle._name)
        # For what returns at once: giving the GIL away costs a turn in the queue for it.
        quick = ct.PyDLL(DDS._dll_handle._name)
        self._status_changes = quick.dds_get_status_changes
        self._status_changes.argtypes = [ct.c_int32, ct.c_void_p]
        self._status_changes.restype = ct.c_int32
        self._write = library.dds_write
        self._write.argtypes = [ct.c_int32, ct.c_void_p]
        self._write.restype = ct.c_int32
        self._assert_liveliness = library.dds_assert_liveliness
        self._assert_liveliness.argtypes = [ct.c_int32]
        self._assert_liveliness.restype = ct.c_int32
        self._create_reader = library.dds_create_reader
        self._create_reader.argtypes = [ct.c_int32, ct.c_int32, ct.c_void_p, ct.c_void_p]
        self._create_reader.restype = ct.c_int32
        self._delete = library.dds_delete
        self._delete.argtypes = [ct.c_int32]
        self._delete.restype = ct.c_int32
        self._take_samples = library.dds_take
        self._take_samples.argtypes = [ct.c_int32, ct.c_void_p, ct.c_void_p, ct.c_size_t, ct.c_uint32]
        self._take_samples.restype = ct.c_int32
        self._return_loan = library.dds_return_loan
        self._return_loan.argtypes = [ct.c_int32, ct.c_void_p, ct.c_int32]
        self._return_loan.restype = ct.c_int32
        self._deafmute = library.dds_domain_set_deafmute
        self._deafmute.argtypes = [ct.c_int32, ct.c_bool, ct.c_bool, ct.c_int64]
        self._deafmute.restype = ct.c_int32

    def status_changes(self, entity: Any) -> int:
        """The statuses that have changed since they were read last, bits of `DDSStatus`."""
        bits = ct.c_uint32()
        code = self._status_changes(entity._ref, ct.byref(bits))
        if code != DDSException.DDS_RETCODE_OK:
            raise DDSException(code, "while getting the status changes")
        return bits.value

    def types_of(self, participant: Any, topic: str) -> set[str]:
        """The type names with which a topic is in use, here and at all peers discovered so far.

        Raises `DDSException`. The binding's own reader of built-in topics is part of a reference cycle,
        and what the cycle collector frees the binding does not delete in DDS: every one leaks.
        """
        found: set[str] = set()
        for builtin in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription):
            reader = self._create_reader(participant._ref, builtin._ref, None, None)
            if reader < 0:
                raise DDSException(reader, "while reading what has been discovered")
            try:
                found |= {
                    endpoint.type_name.decode()
                    for endpoint in self._take(reader)
                    if endpoint.topic_name == topic.encode()
                }
            finally:
                self._delete(reader)
        return found

    def _take(self, reader: int) -> Iterator[_Endpoint]:
        count = _BATCH
        while count == _BATCH:
            loans = (ct.POINTER(_Endpoint) * _BATCH)()
            infos = (dds_c_t.sample_info * _BATCH)()
            count = self._take_samples(reader, loans, infos, _BATCH, _BATCH)
            if count < 0:
                raise DDSException(count, "while reading what has been discovered")
            for loan, info in zip(loans[:count], infos[:count], strict=True):
                if info.valid_data:
                    yield loan.contents
            self._return_loan(reader, loans, count)

    def write(self, writer: Any, cdr: bytes) -> ReturnCode:
        """Write serialized data. The binding's own write holds the GIL while a full history blocks it."""
        sample = Sample(ct.cast(ct.c_char_p(cdr), ct.c_void_p), len(cdr))
        return return_code(self._write(writer._ref, ct.byref(sample)))

    def assert_liveliness(self, entity: Any) -> ReturnCode:
        """Of a writer, or of a participant: for all its MANUAL_BY_PARTICIPANT writers."""
        return return_code(self._assert_liveliness(entity._ref))

    def deafmute(self, entity: Any, deaf: bool, mute: bool) -> ReturnCode:
        """Drop everything that the entity's domain receives, or would send, until told otherwise."""
        return return_code(self._deafmute(entity._ref, deaf, mute, _FOR_EVER))
