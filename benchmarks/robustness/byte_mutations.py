"""Random damage of bytes and text, as by an interrupted copy, a wrong encoding or a slip in an editor."""

import random
from collections.abc import Callable, Sequence

TOKENS = (
    *(b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"1e999", b"0", b"-0", b"-1", b"99999999999999999999"),
    *(
        b"1_0",
        b"9" * 400,
        b"9" * 4301,
        b"0x" + b"f" * 5000,
        b"[" * 3000,
        b"{a = " * 3000,
        b"a." * 3000,
        b"1e15",
        b"1e5",
    ),
    *(b"", b'"', b"'", b"[", b"]", b"{", b"}", b"=", b",", b";", b"\t", b"\n", b"\r", b"#", b"../../x", b"/etc/passwd"),
    *(
        b"1e5",
        b"true",
        b"\x00",
        b"\xff\xfe",
        b"\xef\xbb\xbf",
        "µ·²".encode(),
        b"A" * 5000,
        b"%s%n",
        b"<script>",
        b"1979-05-27",
    ),
    *(b"\x1b[31m", "\u202e".encode(), b"/dev/zero", b"dataset.toml", b"[" * 3000 + b"]" * 3000, b'"\\u001b]0;x"'),
)
"""Replacements of a word or number."""
ENCODINGS = ("utf-16", "utf-8-sig", "utf-32", "cp037")
"""Other encodings of a text file."""

Mutation = Callable[[bytes, random.Random], bytes]


def cut(content: bytes, rng: random.Random) -> bytes:
    """Return the beginning of ``content``."""
    return content[: rng.randrange(len(content) + 1)]


def flip_bytes(content: bytes, rng: random.Random) -> bytes:
    """Return ``content`` with other bytes in some places."""
    mutated = bytearray(content)
    for _ in range(rng.choice((1, 1, 4, 40)) if mutated else 0):
        mutated[rng.randrange(len(mutated))] = rng.randrange(256)
    return bytes(mutated)


def _choose_piece(content: bytes, rng: random.Random) -> tuple[int, int]:
    first = rng.randrange(len(content) + 1)
    return first, min(len(content), first + rng.choice((1, 4, 16, 200)))


def copy_piece(content: bytes, rng: random.Random) -> bytes:
    """Return ``content`` with a piece repeated elsewhere."""
    (first, last), position = _choose_piece(content, rng), rng.randrange(len(content) + 1)
    return content[:position] + content[first:last] * rng.choice((1, 1, 3, 50)) + content[position:]


def delete_piece(content: bytes, rng: random.Random) -> bytes:
    """Return ``content`` without a piece."""
    first, last = _choose_piece(content, rng)
    return content[:first] + content[last:]


def overwrite_count(content: bytes, rng: random.Random) -> bytes:
    """Return ``content`` with a typical count of one to eight bytes in one place, preferably in the header."""
    size = rng.choice((1, 2, 4, 8))
    value = rng.choice((0, 1, 2, 255, 32767, 65535, 2**31 - 1, 2**32 - 1, 2**63 - 1)) % 256**size
    position = rng.randrange(max(1, min(len(content), rng.choice((64, 1024, 4096, len(content) or 1)))))
    return content[:position] + value.to_bytes(size, "little") + content[position + size :]


def replace_token(content: bytes, rng: random.Random) -> bytes:
    """Return ``content`` with another word or number in one place, preferably near the header."""
    end = min(len(content), rng.choice((300, 3000, len(content) or 1)))
    first = last = rng.randrange(end + 1)
    delimiters = b' ,;\t\n="[]{}'
    while first > 0 and content[first - 1] not in delimiters:
        first -= 1
    while last < len(content) and content[last] not in delimiters:
        last += 1
    return content[:first] + rng.choice(TOKENS) + content[last:]


def change_lines(content: bytes, rng: random.Random) -> bytes:
    """Return ``content`` with lines deleted, repeated or exchanged."""
    lines = content.split(b"\n")
    first, second = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(3):
        case 0:
            del lines[first : first + rng.choice((1, 1, 10, 100))]
        case 1:
            lines.insert(second, lines[first])
        case _:
            lines[first], lines[second] = lines[second], lines[first]
    return b"\n".join(lines)


def change_encoding(content: bytes, rng: random.Random) -> bytes:
    """Return the text ``content`` in another encoding, or with other line ends."""
    text = content.decode("utf-8", "replace")
    if rng.random() < 0.3:
        return text.replace("\n", rng.choice(("\r\n", "\r", "\n\n", "\x85"))).encode()
    return text.encode(rng.choice(ENCODINGS), "replace")


TEXT_MUTATIONS: Sequence[Mutation] = (
    *(cut, flip_bytes, copy_piece, delete_piece, change_encoding),
    *(5 * (replace_token,)),
    *(5 * (change_lines,)),
)
BINARY_MUTATIONS: Sequence[Mutation] = (cut, flip_bytes, copy_piece, delete_piece, *(3 * (overwrite_count,)))
