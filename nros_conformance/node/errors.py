"""Negative return codes of the contract as exceptions of the application API."""

from __future__ import annotations

from nros_conformance.rmw.codes import PUBLISHED_CODES, ReturnCode, RmwError, code_name


class UnsupportedError(RmwError):
    """The backend does not generate this event. Ask ``supports_event`` first, or fall back.

    >>> UnsupportedError("LivelinessChanged of the subscription to /imu").code.name
    'UNSUPPORTED'
    """

    def __init__(self, detail: str = "") -> None:
        super().__init__(ReturnCode.UNSUPPORTED, detail)


def raise_for(code: int, detail: str) -> None:
    """Raise what a failure code stands for; OK passes. Detail: what was asked for, and of whom.

    A code outside the published set is an ERROR whose text names it.
    """
    if code == ReturnCode.OK:
        return
    if code == ReturnCode.UNSUPPORTED:
        raise UnsupportedError(detail)
    if code in PUBLISHED_CODES:
        raise RmwError(ReturnCode(code), detail)
    raise RmwError(ReturnCode.ERROR, f"{detail}: {code_name(code)}")
