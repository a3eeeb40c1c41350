"""One reader and one sentence per error for all TOML files."""

import tomllib

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from klute_sim.errors import InputError
from klute_sim.files.limits import FileKind
from klute_sim.files.toml import format_toml, parse_toml, read_toml, validation_sentence


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
        (b"a = " + b"9" * 5000, "file x holds an integer of thousands of digits; allowed: up to 63 bits"),
        (b"a = " + b"9" * 400, "file x: 'a' is an integer of 1329 bits; allowed: up to 63 bits"),
        (b"a = 9223372036854775808", "file x: 'a' is an integer of 64 bits"),
        (b"[t]\na = [1.0, 1e999]", "file x: 't.a.2' is inf; allowed: finite numbers"),
        (b"a = nan", "file x: 'a' is nan; allowed: finite numbers"),
        (b"a = 1979-05-27", "file x: 'a' is a date; allowed: numbers, text"),
        (b'a = "\\u001b[31m"', r"file x: 'a' contains the control character U\+001B"),
        (b'"\\u202e" = 1', r"file x contains the control character U\+202E"),
        (b"a = " + b"[" * 5000, "file x is nested too deeply; allowed: tables and lists in up to 64 others"),
        (b"a = " + b"{b = " * 3000, "file x is nested too deeply"),
        (b"a." * 100_000 + b"a = 1", "file x is nested too deeply"),
        (b"[" + b"a." * 3000 + b"a]", "file x is nested too deeply"),
    ],
)
def test_invalid_toml_is_one_sentence(content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_toml(content, "file x")


def test_byte_order_mark_is_accepted() -> None:
    assert parse_toml(b"\xef\xbb\xbfa = 1", "file x") == {"a": 1}


def test_missing_file_is_one_sentence() -> None:
    with pytest.raises(InputError, match=r"file /no/such/file.toml cannot be read: No such file"):
        read_toml("/no/such/file.toml", FileKind("file", 100))


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"name": "a", "colour": 1}, "unknown key 'colour'; allowed here: name, part, parts"),
        ({"name": "a", "part": {"sise": 1}}, "unknown key 'part.sise'; did you mean 'size'? Allowed here: size"),
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
