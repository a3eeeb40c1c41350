"""Edited MJCF models as files: the model, and the meshes and pictures that it refers to."""

import posixpath
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

import mujoco

from klute_sim.errors import InputError
from klute_sim.files.limits import MODEL_ASSET
from klute_sim.files.reading import read_bytes
from klute_sim.plant.callbacks import compile_model
from klute_sim.plant.mjcf.model_file import ModelFile, describe_model_error

MODEL_FILE_NAME = "model.xml"
"""Name of the file of a model."""
ASSET_FOLDER = "assets"
"""Folder of the meshes and pictures, beside the model."""
_FOLDER_ATTRIBUTES = {"mesh": "meshdir", "skin": "meshdir", "hfield": "meshdir", "texture": "texturedir"}
"""Element of MJCF -> attribute of the compiler that names the folder of its files."""


def build_model_files(file: ModelFile, spec: mujoco.MjSpec) -> dict[str, bytes]:
    """Return name -> content of the files of ``spec``, an edited model of ``file``; see :func:`collect_model_files`."""
    compile_model(spec)  # MuJoCo writes compiled models only
    return collect_model_files(file, spec.to_xml())


def collect_model_files(file: ModelFile, text: str) -> dict[str, bytes]:
    """Return name -> content of ``model.xml`` and of the files to which it refers, in :data:`ASSET_FOLDER`.

    ``text`` is the edited model of ``file`` as MuJoCo writes it: without ``<include>``. Raises InputError where MuJoCo
    cannot load these files, such as those of a model inside the model.
    """
    root = ElementTree.fromstring(text)
    compilers = root.findall("compiler")
    assets: dict[str, bytes] = {}
    for element in root.iter():
        folder_attribute = _FOLDER_ATTRIBUTES.get(element.tag, "")
        asset_folder = next((c.get(folder_attribute) for c in compilers if c.get(folder_attribute)), "")
        for attribute, value in element.attrib.items():
            if attribute.startswith("file") and value:
                path = PurePosixPath(asset_folder or "") / value
                name = posixpath.normpath(ASSET_FOLDER / path)
                assets[name] = read_bytes(file.path.parent / path, MODEL_ASSET)
                element.set(attribute, name)
    if not assets:
        return {MODEL_FILE_NAME: text.encode()}
    for compiler in compilers:
        for attribute in ("meshdir", "texturedir", "assetdir", "strippath"):
            compiler.attrib.pop(attribute, None)
    content = ElementTree.tostring(root, encoding="unicode") + "\n"
    try:
        compile_model(mujoco.MjSpec.from_string(content, assets=assets))
    except ValueError as error:
        raise InputError(
            f"MJCF file {file.path} cannot be written with the files that it refers to "
            f"({describe_model_error(error)}); refer to meshes and pictures in the file itself"
        ) from None
    return {MODEL_FILE_NAME: content.encode(), **assets}


def write_files(files: Mapping[str, bytes], folder: Path) -> None:
    """Write ``files`` (name, with folders -> content) into the existing ``folder``."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
