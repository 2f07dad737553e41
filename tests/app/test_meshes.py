"""The surface that the browser turns."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh

from steered_marigold.app.meshes import guessed_intrinsics, write_mesh
from steered_marigold.core.geometry import project

SIZE = (24, 32)
IMAGE = torch.full((*SIZE, 3), 200, dtype=torch.uint8)


def read(path: Path) -> trimesh.Trimesh:
    scene = trimesh.load(path)
    assert isinstance(scene, trimesh.Scene)
    (mesh,) = scene.geometry.values()
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def test_a_plane_is_one_whole_surface_where_it_was_seen(tmp_path: Path) -> None:
    K = guessed_intrinsics(SIZE)
    assert write_mesh(tmp_path / "a.glb", torch.full(SIZE, 2.0), IMAGE, K) == 2
    mesh = read(tmp_path / "a.glb")
    assert len(mesh.faces) == 2 * 23 * 31
    np.testing.assert_allclose(mesh.vertices[:, 2], -2, atol=1e-6)  # glTF looks along -z
    camera = torch.from_numpy(np.array(mesh.vertices * (1, -1, -1), np.float32))
    pixels = project(camera, K).numpy()
    np.testing.assert_allclose(pixels.min(0), (0, 0), atol=1e-3)
    np.testing.assert_allclose(pixels.max(0), (31, 23), atol=1e-3)
    assert (mesh.face_normals[:, 2] > 0).all()  # towards the camera


def test_no_triangle_lies_across_a_depth_edge_or_on_what_is_not_known(tmp_path: Path) -> None:
    depth = torch.full(SIZE, 2.0)
    depth[:, 16:] = 3.0
    depth[:4, :4] = 0.0
    write_mesh(tmp_path / "a.glb", depth, IMAGE, guessed_intrinsics(SIZE))
    mesh = read(tmp_path / "a.glb")
    corners = -mesh.vertices[mesh.faces][..., 2]
    assert np.ptp(corners, axis=1).max() < 1e-6
    assert corners.min() > 1.9
    squares = 23 * 31 - 23 - 16
    assert len(mesh.faces) == 2 * squares + 1  # at the corner of the hole half a square is left


def test_uncertain_points_fade_then_go(tmp_path: Path) -> None:
    sigma = torch.linspace(0, 0.4, SIZE[1]).expand(SIZE)
    K, depth = guessed_intrinsics(SIZE), torch.full(SIZE, 2.0)
    counts = []
    for most in (1.0, 0.2, 0.05):
        write_mesh(tmp_path / "a.glb", depth, IMAGE, K, uncertainty=sigma, most_uncertain=most)
        counts.append(len(read(tmp_path / "a.glb").faces))
    assert counts[0] > counts[1] > counts[2] > 0
    visual: Any = read(tmp_path / "a.glb").visual
    picture = visual.material.emissiveTexture
    row = np.asarray(picture.convert("RGB"))[0]
    assert row[0].tolist() == [200, 200, 200]
    assert (row[3] < 190).all()
