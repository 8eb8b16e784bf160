"""Pictures of the robot: the visual meshes of its URDF as MuJoCo meshes, one per link and colour.

The originals have 115,000 triangles, far more than a picture of 640x480 pixels shows, and software rendering pays for
each. They are thinned by vertex clustering: vertices in one cell of a grid become one vertex at their mean and
triangles that collapse disappear.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.errors import ConfigError
from control.robot.description_files import panda_description
from sim_check.models.urdf import UrdfLink, child, origin

CELL = 0.0025  # side of a clustering cell in [m]: under a pixel from a metre away at 640x480 and 60 degrees
# Coloured parts under this many triangles (a status light's faces, screws) are not worth a mesh of their own.
SMALLEST_PART = 60


@dataclass(frozen=True)
class ColouredMesh:
    """Triangles of one colour in a link's frame.

    Attributes:
        vertices: Shape (n, 3), float32, in [m].
        faces: Vertex indices, shape (m, 3), int32.
        colour: Red, green, blue, alpha from 0 to 1, shape (4,).
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    colour: NDArray[np.float64]


def add_pictures(spec: mujoco.MjSpec, links: Sequence[UrdfLink], group: int, cache: Path | None = None) -> None:
    """Add the visual meshes of all links to their bodies, without contacts.

    Args:
        spec: A specification whose bodies carry the links' names.
        links: The robot's links.
        group: Group of the pictures' geoms.
        cache: Folder that keeps the thinned meshes as one file; created when missing. None converts every time.

    Raises:
        ConfigError: A mesh file that the URDF names is missing.
    """
    sources = {link.name: visual for link in links if (visual := link.element.find("visual")) is not None}
    files = {name: _mesh_file(visual) for name, visual in sources.items()}
    parts = _thinned(sorted(set(files.values())), cache)
    for file, meshes in parts.items():
        for i, part in enumerate(meshes):
            mesh = spec.add_mesh(name=f"{file.stem}_{i}")
            mesh.uservert = part.vertices.ravel()
            mesh.userface = part.faces.ravel()
            # Open surfaces have no volume; the body's inertia comes from the URDF anyway.
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    for name, visual in sources.items():
        pos, quat = origin(visual)
        for i, part in enumerate(parts[files[name]]):
            spec.body(name).add_geom(
                name=f"{name}_picture{i}",
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"{files[name].stem}_{i}",
                pos=pos,
                quat=quat,
                rgba=part.colour,
                group=group,
                contype=0,
                conaffinity=0,
                mass=0.0,
            )


def load_parts(file: Path, cell: float = CELL) -> list[ColouredMesh]:
    """Read a COLLADA file, merge its parts by colour and thin them.

    Args:
        file: A .dae file in [m].
        cell: Side of a clustering cell in [m].

    Raises:
        ConfigError: The file is missing.
    """
    import trimesh

    if not file.is_file():
        raise ConfigError(f"the robot's mesh {file.name} is missing; reinstall example-robot-data")
    by_colour: dict[tuple[int, ...], list[trimesh.Trimesh]] = {}
    for part in trimesh.load_scene(file).dump():
        if isinstance(part, trimesh.Trimesh) and len(part.faces) >= SMALLEST_PART:
            colour = tuple(int(c) for c in part.visual.material.main_color)  # type: ignore[union-attr]
            by_colour.setdefault(colour, []).append(part)
    meshes = []
    for colour, same in sorted(by_colour.items()):
        merged = trimesh.util.concatenate(same)
        assert isinstance(merged, trimesh.Trimesh)
        vertices, faces = thin(np.asarray(merged.vertices), np.asarray(merged.faces), cell)
        if len(faces):
            meshes.append(ColouredMesh(vertices.astype(np.float32), faces.astype(np.int32), np.array(colour) / 255.0))
    return meshes


def thin(vertices: np.ndarray, faces: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertex clustering.

    Args:
        vertices: Shape (n, 3), in [m].
        faces: Vertex indices, shape (m, 3).
        cell: Side of a cell in [m]; no vertex moves farther than its diagonal.

    Returns:
        The kept vertices, shape (k, 3), and the faces with three different corners, shape (l, 3).
    """
    _, owner = np.unique(np.floor(vertices / cell).astype(np.int64), axis=0, return_inverse=True)
    owner = owner.ravel()
    count = np.bincount(owner)
    merged = np.stack([np.bincount(owner, weights=vertices[:, i]) / count for i in range(3)], axis=1)
    faces = owner[faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    used, faces = np.unique(faces, return_inverse=True)
    return merged[used], faces.reshape(-1, 3)


def _mesh_file(visual: ElementTree.Element) -> Path:
    mesh = child(child(visual, "geometry"), "mesh")
    # package://example-robot-data/robots/panda_description/meshes/visual/link0.dae
    return panda_description() / str(mesh.get("filename")).rsplit("panda_description/", 1)[-1]


def _thinned(files: list[Path], cache: Path | None) -> dict[Path, list[ColouredMesh]]:
    if cache is None:
        return {file: load_parts(file) for file in files}
    store = cache / f"panda_meshes_{round(CELL * 1e6)}um.npz"
    if store.is_file():
        with np.load(store) as kept:
            found = {
                file: [
                    ColouredMesh(*(kept[f"{file.stem}/{i}/{key}"] for key in ("vertices", "faces", "colour")))
                    for i in range(int(kept[f"{file.stem}/count"]))
                ]
                for file in files
                if f"{file.stem}/count" in kept
            }
        if len(found) == len(files):
            return found
    parts = {file: load_parts(file) for file in files}
    arrays: dict[str, np.ndarray] = {}
    for file, meshes in parts.items():
        arrays[f"{file.stem}/count"] = np.array(len(meshes))
        for i, part in enumerate(meshes):
            arrays |= {f"{file.stem}/{i}/{key}": getattr(part, key) for key in ("vertices", "faces", "colour")}
    cache.mkdir(parents=True, exist_ok=True)
    partial = store.with_suffix(".partial.npz")
    np.savez_compressed(partial, **arrays)  # type: ignore[arg-type]
    partial.replace(store)
    return parts
