"""Open a MAT-file of any version."""

from collections.abc import Collection

from klute_sim.errors import InputError
from klute_sim.files.mat.contents import MatFile
from klute_sim.files.mat.hdf5 import is_hdf5, open_hdf5
from klute_sim.files.mat.level5 import HEADER_BYTES, open_level5

MAT_MAGIC = b"MATLAB"
"""First bytes of a MAT-file."""


def open_mat(content: bytes, description: str, names: Collection[str] = ()) -> MatFile:
    """Open the MAT-file ``content`` of versions 5 to 7.3; ``description`` names it in errors.

    Of a file of version 7.3, only the arrays of the signals in ``names`` can be read. Raises InputError when it is no
    such file, is damaged, or holds more than the limits allow, and MissingExtraError for version 7.3 without h5py.
    """
    if len(content) < HEADER_BYTES:
        raise InputError(f"{description} is not a MAT-file: it has {len(content)} bytes; its header has {HEADER_BYTES}")
    if is_hdf5(content):
        return open_hdf5(content, description, names)
    if not content.startswith(MAT_MAGIC) or content[126:128] not in (b"IM", b"MI"):
        raise InputError(
            f"{description} is not a MAT-file of version 5 or later; write it in MATLAB with save(..., '-v7')"
        )
    return open_level5(content, description)
