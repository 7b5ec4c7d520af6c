"""DDS-XRCE 1.0 on the wire: values of messages, and the codec between them and bytes."""

from nros_backends.xrce.wire.cdr import Malformed
from nros_backends.xrce.wire.codec import decode, decode_body, encode, encode_body
from nros_backends.xrce.wire.messages import Header, Message, Submessage

__all__ = ["Header", "Malformed", "Message", "Submessage", "decode", "decode_body", "encode", "encode_body"]
