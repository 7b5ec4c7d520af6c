"""Return codes of the nano-ros RMW boundary (``nros/rmw_ret.h``, without the prefix ``NROS_RMW_RET_``)."""

from __future__ import annotations

import enum


class ReturnCode(enum.IntEnum):
    """The published set: 0 is success, every failure is negative."""

    OK = 0
    ERROR = -1
    TIMEOUT = -2
    BAD_ALLOC = -3
    INVALID_ARGUMENT = -4
    UNSUPPORTED = -5
    INCOMPATIBLE_QOS = -6
    TOPIC_NAME_INVALID = -7
    NODE_NAME_NON_EXISTENT = -8
    LOAN_NOT_SUPPORTED = -9
    NO_DATA = -10
    WOULD_BLOCK = -11
    BUFFER_TOO_SMALL = -12
    MESSAGE_TOO_LARGE = -13
    INCOMPATIBLE_ABI = -14
    NO_BACKEND = -15
    AMBIGUOUS_BACKEND = -16
    UNKNOWN_BACKEND = -17
    CONNECTION_FAILED = -18
    INVALID_CONFIG = -19


PUBLISHED_CODES = frozenset(int(code) for code in ReturnCode)
PUBLISHED_ERRORS = PUBLISHED_CODES - {int(ReturnCode.OK)}


def code_name(code: int) -> str:
    """``-5`` -> ``UNSUPPORTED``; a code outside the published set -> ``unpublished code -77``."""
    try:
        return ReturnCode(code).name
    except ValueError:
        return f"unpublished code {code}"


class RmwError(Exception):
    """The one exception that creation calls raise; it carries the return code.

    >>> RmwError(ReturnCode.INCOMPATIBLE_QOS, "lease below 100 ms").code.name
    'INCOMPATIBLE_QOS'
    """

    def __init__(self, code: ReturnCode, detail: str = "") -> None:
        super().__init__(f"{code.name} ({int(code)})" + (f": {detail}" if detail else ""))
        self.code = code
        self.detail = detail
