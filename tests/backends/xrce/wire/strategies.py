"""Hypothesis strategies for every kind of message."""

from __future__ import annotations

from hypothesis import strategies as st

from nros_backends.xrce.wire import messages as m
from nros_backends.xrce.wire.ids import Kind, ObjectId

u8 = st.integers(0, 0xFF)
u16 = st.integers(0, 0xFFFF)
u32 = st.integers(0, 0xFFFFFFFF)
i16 = st.integers(-0x8000, 0x7FFF)
i32 = st.integers(-0x80000000, 0x7FFFFFFF)
pairs = st.tuples(u8, u8)
texts = st.text(max_size=12)
octets = st.binary(max_size=40)
cookies = st.binary(min_size=4, max_size=4)
ids = st.builds(ObjectId, st.integers(0, 0xFFF), st.sampled_from(Kind))
little = st.booleans()
formats = st.sampled_from((0x00, 0x02, 0x08, 0x0A, 0x0E))
times = st.builds(m.Time, i32, u32)
representations = st.one_of(st.builds(m.Ref, texts), st.builds(m.Xml, texts), st.builds(m.Binary, octets))

requests = {"request": u16, "object": ids, "little": little}
submessages = st.one_of(
    st.builds(
        m.CreateClient, key=u32, session=u8, mtu=u16, cookie=cookies, version=pairs, vendor=pairs, little=little,
        properties=st.lists(st.tuples(texts, texts), max_size=3).map(tuple),
    ),
    st.builds(
        m.Create, kind=st.sampled_from([kind for kind in Kind if kind is not Kind.PARTICIPANT]),
        representation=representations, parent=ids, reuse=little, replace=little, **requests,
    ),
    st.builds(
        m.Create, kind=st.just(Kind.PARTICIPANT), representation=representations, domain=i16, reuse=little,
        replace=little, **requests,
    ),
    st.builds(m.GetInfo, mask=u32, **requests),
    st.builds(m.Delete, **requests),
    st.builds(m.StatusAgent, status=u8, implementation=u8, cookie=cookies, version=pairs, vendor=pairs, little=little),
    st.builds(m.StatusReply, status=u8, implementation=u8, **requests),
    st.builds(
        m.Info, status=u8, implementation=u8,
        configuration=st.none() | st.builds(m.AgentConfiguration, cookies, pairs, pairs),
        activity=st.none() | st.builds(m.AgentActivity, i16), **requests,
    ),
    st.builds(m.WriteData, data=octets, format=formats, **requests),
    st.builds(m.Data, data=octets, format=formats, **requests),
    st.builds(
        m.ReadData, stream=u8, format=u8, content_filter=st.none() | texts,
        delivery=st.none() | st.builds(m.DeliveryControl, u16, u16, u16, u16), **requests,
    ),
    st.builds(m.Acknack, first_unacked=u16, missing=u16, stream=u8, little=little),
    st.builds(m.Heartbeat, first=u16, last=u16, stream=u8, little=little),
    st.builds(m.Reset, little=little),
    st.builds(m.Fragment, data=octets, last=little, little=little),
    st.builds(m.Timestamp, transmit=times, little=little),
    st.builds(m.TimestampReply, transmit=times, receive=times, originate=times, little=little),
    st.builds(
        m.Unknown, id=st.integers(16, 255), flags=st.integers(0, 127).map(lambda n: n << 1), payload=octets,
        little=little,
    ),
)  # fmt: skip
headers = st.one_of(
    st.builds(m.Header, st.integers(0x80, 0xFF), u8, u16),
    st.builds(m.Header, st.integers(0, 0x7F), u8, u16, u32),
)
messages = st.builds(m.Message, headers, st.lists(submessages, max_size=4).map(tuple))
