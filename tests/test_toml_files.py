"""One reader and one sentence per error for all TOML files."""

import tomllib

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from klute_sim.errors import InputError
from klute_sim.toml_files import format_toml, parse_toml, read_toml, validation_sentence


class Part(BaseModel):
    model_config = ConfigDict(extra="forbid")
    size: float = Field(gt=0)


class Document(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str
    part: Part | None = None
    parts: list[Part] = Field(default_factory=list)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfe", "file x cannot be read: not a UTF-8 text file"),
        (b"[a", "file x is not valid TOML"),
        (b"a = " + b"9" * 5000, "file x is not valid TOML"),
        (b"a = " + b"[" * 5000, "file x is not valid TOML"),
    ],
)
def test_invalid_toml_is_one_sentence(content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_toml(content, "file x")


def test_byte_order_mark_is_accepted() -> None:
    assert parse_toml(b"\xef\xbb\xbfa = 1", "file x") == {"a": 1}


def test_missing_file_is_one_sentence() -> None:
    with pytest.raises(InputError, match=r"file x cannot be read: No such file"):
        read_toml("/no/such/file.toml", "file x")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"name": "a", "colour": 1}, "unknown key 'colour'; allowed here: name, part, parts"),
        ({"name": "a", "part": {"sise": 1}}, "unknown key 'part.sise'; allowed here: size"),
        ({"name": "a", "parts": [{"size": 1, "a": 1}]}, "unknown key 'parts.1.a'; allowed here: size"),
        ({}, "key 'name' is missing"),
        ({"name": "a", "part": {"size": -1}}, "part.size = -1 is refused: input should be greater than 0"),
        ({"name": "a", "part": {"size": "9" * 99}}, "part.size = '" + "9" * 56 + "... is refused"),
    ],
)
def test_validation_sentence_names_key_value_and_allowed(content: dict, sentence: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Document.model_validate(content, strict=True)
    assert validation_sentence(caught.value, Document).startswith(sentence)


def test_several_problems_are_counted() -> None:
    with pytest.raises(ValidationError) as caught:
        Document.model_validate({"a": 1, "b": 2, "c": 3})
    assert validation_sentence(caught.value, Document, max_problems=2).endswith("(and 2 more)")


def test_written_toml_reads_back() -> None:
    content = {"name": 'a "b"\x7f', "part": {"size": 1.5, "odd key": True}, "parts": [{"size": 1}, {"size": 2}]}
    assert tomllib.loads(format_toml(content)) == content
