"""MJCF files of mechanisms: those of the package, and those of a user, which refer to files in their folder only."""

import hashlib
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import mujoco

from klute_sim.errors import InputError, suggest
from klute_sim.files.limits import MJCF
from klute_sim.files.reading import MissingFileError, read_bytes
from klute_sim.plant.callbacks import compile_model
from klute_sim.plant.models import get_models_folder

MODEL_NAMES = ("antagonist_joint", "hanging_mass", "knee_jig")
"""Mechanisms that come with the package."""
MAX_INCLUDED_FILES = 50
"""Largest number of files that a model includes, itself among them."""
INTEGRATORS = {
    mujoco.mjtIntegrator.mjINT_EULER: "Euler",
    mujoco.mjtIntegrator.mjINT_IMPLICIT: "implicit",
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST: "implicitfast",
}
"""Integrators that a mechanism may use, with their names in MJCF. Others advance a device's states differently."""


@dataclass(frozen=True)
class ModelFile:
    """An MJCF file whose content and references have been checked."""

    name: str
    """Name of the file without ending."""
    path: Path
    """Path of the file."""
    content: bytes
    """Content."""
    digest: str
    """SHA-256 over the file and the files that it includes."""

    def make_spec(self) -> mujoco.MjSpec:
        """Return a new editable model."""
        try:
            return mujoco.MjSpec.from_file(str(self.path))
        except ValueError as error:
            raise InputError(f"MJCF file {self.path} is no model: {describe_model_error(error)}") from None


def load_model_file(name_or_path: str | Path) -> ModelFile:
    """Return the model of the package with that name, or the MJCF file at that path.

    Raises InputError when there is no such file, it is no MJCF model, it refers to a file outside its folder, its
    integrator cannot advance a device, or MuJoCo cannot compile it.
    """
    name = str(name_or_path)
    path = get_models_folder() / f"{name}.xml" if name in MODEL_NAMES else Path(name)
    digest = hashlib.sha256()
    try:
        content = _check_references(path, path.parent, [], digest)
    except MissingFileError as error:
        if path.is_file():
            raise InputError(f"MJCF file {path} includes a file that is missing: {error}") from None
        hint = f"give the path of an MJCF file, or one of {', '.join(MODEL_NAMES)}"
        raise InputError(f"no model '{name}': {suggest(name, MODEL_NAMES, hint)}") from None
    file = ModelFile(path.stem, path, content, digest.hexdigest())
    spec = file.make_spec()
    if spec.option.integrator not in INTEGRATORS:
        raise InputError(
            f"MJCF file {path}: a device cannot be advanced by its integrator; allowed: "
            f"{', '.join(INTEGRATORS.values())} (<option integrator=.../>)"
        )
    try:
        compile_model(spec)
    except ValueError as error:
        raise InputError(
            f"MJCF file {path} cannot be compiled ({describe_model_error(error)}); correct the file"
        ) from None
    return file


def _check_references(path: Path, folder: Path, visited: list[Path], digest: "hashlib._Hash") -> bytes:
    """Return the content of the file at ``path`` after checking that all its references stay in ``folder``."""
    if path in visited or len(visited) >= MAX_INCLUDED_FILES:
        raise InputError(f"MJCF file {path} is included twice or is one of more than {MAX_INCLUDED_FILES} files")
    visited.append(path)
    content = read_bytes(path, MJCF)
    digest.update(hashlib.sha256(content).digest())
    if b"<!" in content.replace(b"<!--", b""):
        raise InputError(f"MJCF file {path} declares a document type or entities, which are refused; remove them")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"MJCF file {path} is no XML: {error}") from None
    for element in root.iter():
        for attribute, value in element.attrib.items():
            if attribute in ("file", "meshdir", "texturedir", "assetdir") or attribute.startswith("file"):
                _check_inside(value, path, folder)
        if element.tag == "include":
            if not element.attrib.get("file"):
                raise InputError(f"MJCF file {path} has an <include> without file; name the file, or remove it")
            _check_references(folder / element.attrib["file"], folder, visited, digest)
    return content


def _check_inside(reference: str, path: Path, folder: Path) -> None:
    target = Path(reference)
    if target.is_absolute() or not (folder / target).resolve().is_relative_to(folder.resolve()):
        raise InputError(
            f"MJCF file {path} refers to '{reference}', which is outside its folder; copy the file into the folder "
            f"{folder} and refer to it there"
        )


def describe_model_error(error: Exception) -> str:
    """Return MuJoCo's ``error`` about a model in one line."""
    return " ".join(str(error).split()).removeprefix("Error: ") or "unknown error"
