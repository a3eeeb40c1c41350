"""Limits of files: the size of each kind, and the size of what a file holds.

All limits are assumed. They lie far above what measurements, devices and runs need, and low enough that any file is
read or refused within 1 GB of memory.
"""

from typing import NamedTuple

MB = 1_000_000
"""Bytes in a megabyte."""


class FileKind(NamedTuple):
    """A kind of file that a user can give."""

    name: str
    """Name of the kind in messages, such as ``device file``; '' if the path speaks for itself."""
    max_bytes: int
    """Largest accepted size [bytes]."""

    def describe(self, path: object) -> str:
        """Return kind and path for messages."""
        return f"{self.name} {path}".lstrip()


DEVICE = FileKind("device file", MB)
DATASET = FileKind("", MB)
PROTOCOL = FileKind("protocol file", MB)
MJCF = FileKind("MJCF file", MB)
MODEL_ASSET = FileKind("file of a model", 64 * MB)
"""A mesh or a picture."""
STATE_MACHINE = FileKind("state machine", MB)
MAPPING = FileKind("", MB)
TRAINING_CONFIG = FileKind("configuration", MB)
PUBLISHED_NUMBERS = FileKind("file of published numbers", MB)
REFERENCE_METADATA = FileKind("", MB)
PROFILE = FileKind("pressure profile", MB)
REFERENCE = FileKind("reference", 4 * MB)
TRIAL = FileKind("trial file", 128 * MB)
RECORDING = FileKind("recording", 128 * MB)
MOTION = FileKind("", 64 * MB)
WALKER = FileKind("walker", MB)
TABLE = FileKind("table", MB)
POLICY = FileKind("policy", 64 * MB)
CHECKPOINT = FileKind("checkpoint", 256 * MB)
CATALOGUE = FileKind("catalogue", 4 * MB)
RESULT = FileKind("", 8 * MB)
"""JSON and CSV files that klute-sim wrote into the folder of a run, sweep, tuning or training."""
FIT = FileKind("", 64 * MB)
"""A fit in the cache."""

MAX_NESTING = 64
"""Deepest nesting of tables and lists in TOML and JSON."""
MAX_TOML_ITEMS = 50_000
"""Largest number of keys, list items and tables in TOML, which Python parses slowly."""
MAX_JSON_ITEMS = 1_000_000
"""Largest number of keys, list items and objects in JSON."""
MAX_INTEGER = 2**63 - 1
"""Largest magnitude of an integer in TOML and JSON; TOML requires no more."""
MAX_COLUMNS = 4096
"""Largest number of columns of a table."""
MAX_LINES = 10_000_000
"""Largest number of lines of a text table."""
MAX_LINE_BYTES = 1_000_000
"""Longest line of a text table [bytes]."""
MAX_VALUES = 32_000_000
"""Largest number of values that a table holds once it is decoded: an hour of eight channels at 1 kHz, 256 MB."""
MAX_TEXT_VALUES = 4_000_000
"""Largest number of values of a table with text, such as that of a sweep, which takes more memory for each."""
MAX_DECODED_BYTES = 512 * MB
"""Largest decoded size of a compressed file [bytes]."""
MAX_ARCHIVE_ENTRIES = 1000
"""Largest number of arrays in a NumPy archive."""
MAX_DURATION = 3600.0
"""Longest trial or recording [s]."""
