"""Read arrays of numbers from MAT-files of version 7.3, which are HDF5 files (optional extra h5py).

The library HDF5 reads the file in a separate process (:mod:`klute_sim.files.mat.hdf5_process`), because damaged files
can crash it.
"""

from collections.abc import Collection
from importlib.util import find_spec

from klute_sim.errors import MissingExtraError
from klute_sim.files.isolation import run_isolated
from klute_sim.files.json import parse_json
from klute_sim.files.limits import MAX_DECODED_BYTES
from klute_sim.files.mat.contents import MatContents, MatFile
from klute_sim.files.npz import parse_npz

SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""First bytes of HDF5."""
_OFFSETS = (512, 0)
"""Where the signature may stand: after MATLAB's header, or, in a file of another program, at the beginning."""


def is_hdf5(content: bytes) -> bool:
    """Return whether ``content`` is an HDF5 file, with or without MATLAB's header."""
    return any(content[offset : offset + len(SIGNATURE)] == SIGNATURE for offset in _OFFSETS)


def open_hdf5(content: bytes, description: str, names: Collection[str]) -> MatFile:
    """Open the MAT-file ``content`` of version 7.3, and read the arrays of the signals in ``names``.

    Raises MissingExtraError without h5py, and InputError when the file is damaged or too large.
    """
    if find_spec("h5py") is None:
        raise MissingExtraError("reading MAT-files of version 7.3", "mat")
    arrays = sorted({name.partition("(")[0] for name in names})
    archive = run_isolated(
        "klute_sim.files.mat.hdf5_process", arrays, len(content), description, "MAT-file of version 7.3", content
    )
    result = parse_npz(archive, description, 2 * MAX_DECODED_BYTES)
    metadata = parse_json(str(result["metadata"]), description)
    contents = MatContents(description, unreadable=metadata["unreadable"])
    for name, shape in metadata["shapes"].items():
        contents.add_numbers(name, shape)
    return MatFile(contents, lambda name: result[f"array{metadata['read'].index(name)}"])
