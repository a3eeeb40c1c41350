"""Small files that decode to very much, and a process that reads them and measures its memory.

python -m tests.files.bombs FOLDER
"""

import io
import json
import re
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import savemat

from klute_sim.comparison import runs
from klute_sim.controllers import policy, pressure, state_machine
from klute_sim.datasets.trial_files.table import read_trial_file
from klute_sim.device.device import load_device
from klute_sim.errors import KluteSimError
from klute_sim.files.json import read_json
from klute_sim.files.limits import RECORDING, RESULT
from klute_sim.files.parquet import open_parquet
from klute_sim.gait import reference
from klute_sim.mocap.parsing import sources

ROWS, GROUPS = 1_000_000, 40


def _write_parquet(path: Path) -> None:
    """Write 40 million zeros, which take almost no space."""
    table = pa.table({"time [s]": np.zeros(ROWS)})
    with pq.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(GROUPS):
            writer.write_table(table)


def _write_text_parquet(path: Path) -> None:
    """Write one long text, repeated a million times."""
    text = pa.DictionaryArray.from_arrays(np.zeros(ROWS, np.int32), ["x" * 100_000])
    schema = pa.schema([("device", pa.dictionary(pa.int32(), pa.string()))])
    pq.write_table(pa.table({"device": text}).cast(schema), path)


def _write_npz(path: Path, n_megabytes: int = 100) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "|u1", "fortran_order": False, "shape": (n_megabytes * 1_000_000,)}
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("weights_0.npy", "w") as file:
        file.write(header.getvalue())
        for _ in range(n_megabytes):
            file.write(bytes(1_000_000))


def _write_shape(path: Path) -> None:
    """Write an array that states more values than it has."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**10,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("weights_0.npy", header.getvalue() + bytes(8))


def _write_mat(path: Path) -> None:
    """Write an array of 2 GB of zeros, of which the file holds the first 100 MB."""
    compressor = zlib.compressobj(1)
    data = compressor.compress(struct.pack("<2I", 14, 2_000_000_000) + bytes(100_000_000)) + compressor.flush()
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(header + struct.pack("<2I", 15, len(data)) + data)


def _write_structs(path: Path) -> None:
    """Write a struct in a struct and so on, and one with very many fields."""
    nested: dict[str, object] = {"x": np.zeros(10)}
    for _ in range(200):
        nested = {"a": nested}
    savemat(path, {"deep": nested, "wide": {f"f{number}": 1.0 for number in range(5000)}})


def _write_sparse(path: Path, size: int = 200_000_000) -> None:
    """Write a file of zeros without using the disk."""
    with path.open("wb") as file:
        file.truncate(size)


def _read_trial(path: Path) -> object:
    return read_trial_file(path, {"time": "s", "force": "N"})


def _read_sweep(path: Path) -> object:
    return open_parquet(path.read_bytes(), RECORDING.describe(path), with_text=True).read_rows()


def _read_result(path: Path) -> object:
    return read_json(path, RESULT)


def _read_run(path: Path) -> object:
    return runs.read_runs([str(path)])


_Writer = Callable[[Path], object]
_Reader = Callable[[Path], object]


def _text(content: str) -> _Writer:
    return lambda path: path.write_text(content, "utf-8")


_MOT = "a\nversion=1\nnRows=2\nnColumns=2\ninDegrees=yes\nendheader\ntime\tankle_angle_r\n"
BOMBS: dict[str, tuple[_Writer, _Reader, str]] = {
    "trial.parquet": (_write_parquet, _read_trial, "40000000 rows of 1 columns in 40 row groups; allowed: up to"),
    "run.parquet": (_write_parquet, _read_run, "40000000 rows of 1 columns in 40 row groups; allowed: up to"),
    "log.parquet": (_write_parquet, sources.read, "40000000 rows of 1 columns in 40 row groups; allowed: up to"),
    "sweep.parquet": (_write_text_parquet, _read_sweep, "decodes to 1e+05 MB; allowed: up to 512 MB"),
    "zeros.mat": (_write_mat, _read_trial, "decodes to 2000 MB or more; allowed: up to 256 MB"),
    "structs.mat": (_write_structs, _read_trial, "has more than 4096 columns; allowed: up to 4096"),
    "large.mat": (_write_sparse, _read_trial, "large.mat has 200 MB; allowed: up to 128 MB"),
    "policy.npz": (_write_npz, policy.load_policy, "holds 1 arrays of 100 MB; allowed: up to"),
    "shape.npz": (_write_shape, policy.load_policy, "states shape (10000000000,), which its data does not fill"),
    "large.csv": (_write_sparse, _read_trial, "large.csv has 200 MB; allowed: up to 128 MB"),
    "large.c3d": (_write_sparse, sources.read, "large.c3d has 200 MB; allowed: up to 64 MB"),
    "large.toml": (_write_sparse, load_device, "large.toml has 200 MB; allowed: up to 1 MB"),
    "line.csv": (_text("time [s]," + "x" * 2_000_000), _read_trial, "has a line of more than 1,000,000 bytes"),
    "columns.csv": (_text("a," * 5000 + "\n" + "1," * 5000), _read_trial, "has 5001 columns; allowed: up to 4096"),
    "lines.csv": (_text("time [s],force [N]" + "\n" * 30_000_000), _read_trial, "has more than 10,000,000 lines"),
    "quote.csv": (_text('time [s],force [N]\n0,"1\n' + "1,2\n" * 100_000), _read_trial, "line 2 opens a quote"),
    "deep.toml": (_text("a = " + "[" * 3000), load_device, "is nested too deeply; allowed: tables and lists in up to"),
    "keys.toml": (_text("a." * 400_000 + "a = 1"), load_device, "is nested too deeply"),
    "digits.toml": (_text("a = " + "9" * 4301), state_machine.load_state_machine, "an integer of thousands of digits"),
    "integer.toml": (_text("a = " + "9" * 400), state_machine.load_state_machine, "is an integer of 1329 bits"),
    "items.toml": (_text("a = [" + "[]," * 300_000 + "]"), load_device, "has more than 50,000 keys, list items and"),
    "items.json": (_text("[" + "[]," * 2_000_000 + "0]"), _read_result, "has more than 1,000,000 keys, list items and"),
    "deep.json": (_text("[" * 1_000_000), _read_result, "is nested too deeply"),
    "digits.json": (_text("9" * 1_000_000), _read_result, "an integer has 1000000 digits"),
    "nan.json": (_text('{"a": NaN}'), _read_result, "'a' is nan; allowed: finite numbers"),
    "profile.csv": (_text('"' * 999_999), pressure.load_profile, "pressure profile"),
    "reference.csv": (_text("gait_pct," + "x," * 10_000), reference.load_reference, "has 10002 columns; allowed"),
    "late.csv": (
        _text("time [s],force [N]\n0,1\n1,1\n1e5,1\n"),
        _read_run,
        "time spans 100000 s; allowed: up to",
    ),
    "nan.csv": (_text("time [s],force [N]\n0,1\nnan,1\n2,1\n"), _read_run, "time is missing in row 2"),
    "inf.mot": (_text(_MOT + "0\t1\ninf\t1\n"), sources.read, "'inf' is not a finite number"),
    "nan.mot": (_text(_MOT + "0\t1\nnan\t1\n"), sources.read, "column 'time' must increase strictly"),
}
"""Name of the file -> its writer, its reader and a part of the sentence with which it is refused."""


def _read_peak_memory() -> float:
    """Return the largest resident memory [MB] of this process since it was started."""
    status = Path("/proc/self/status")
    if status.exists():  # ru_maxrss would include the memory of the parent at the fork
        return float(re.findall(r"VmHWM:\s+(\d+) kB", status.read_text())[0]) / 1000.0
    import resource  # not on Windows

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0


def main() -> None:
    """Read all bombs in the folder on the command line; print the sentences by name, and the peak memory [MB]."""
    folder, sentences = Path(sys.argv[1]), {}
    for name, (_, read, _) in BOMBS.items():
        try:
            read(folder / name)
            sentences[name] = "was read"
        except KluteSimError as error:
            sentences[name] = str(error)
    megabytes = _read_peak_memory()
    print(json.dumps({"sentences": sentences, "megabytes": megabytes}))


if __name__ == "__main__":
    main()
