from __future__ import annotations

from collections.abc import Iterator

import msgspec
import pytest

from nros_conformance.suite import schema

STRUCTS = [value for value in vars(schema).values() if isinstance(value, type) and issubclass(value, schema.Base)]


def unions(info: msgspec.inspect.Type) -> Iterator[msgspec.inspect.UnionType]:
    if isinstance(info, msgspec.inspect.UnionType):
        yield info
        for one in info.types:
            yield from unions(one)
    if isinstance(info, msgspec.inspect.ListType):
        yield from unions(info.item_type)
    if isinstance(info, msgspec.inspect.DictType):
        yield from unions(info.value_type)


@pytest.mark.parametrize("struct", STRUCTS)
def test_no_union_of_a_container_and_a_text_with_a_pattern(struct: type[schema.Base]) -> None:
    # msgspec would crash when the interpreter ends, and turn exit code 0 into 139: see EntityNames.
    info = msgspec.inspect.type_info(struct)
    assert isinstance(info, msgspec.inspect.StructType)
    for field in info.fields:
        for union in unions(field.type):
            patterns = [one for one in union.types if isinstance(one, msgspec.inspect.StrType) and one.pattern]
            containers = [
                one for one in union.types if isinstance(one, (msgspec.inspect.ListType, msgspec.inspect.DictType))
            ]
            assert not (patterns and containers), field.name


def test_every_head_is_a_field_of_its_type() -> None:
    for types in (schema.STEPS, schema.GIVENS, schema.EXPECTATIONS):
        for head, type_ in types.items():
            assert head in type_.__struct_encode_fields__


def test_profiles_widen_from_smoke_to_publish() -> None:
    assert schema.PROFILES == ("smoke", "standard", "publish")
