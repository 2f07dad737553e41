"""The geometry of a room in Embree, with the attributes of its surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float32, Int

from rooms.bank import lookup, mean_albedo
from rooms.materials import Material
from rooms.mesh import join
from rooms.models import Part
from rooms.vectors import cross, dot, unit

Vectors = Float32[np.ndarray, "n 3"]
Scalars = Float32[np.ndarray, " n"]

FAR_M = 100.0


@dataclass(frozen=True)
class Hits:
    """Where rays meet the scene: distance in units of the direction, triangle, barycentrics.

    A ray that meets nothing has triangle -1 and distance FAR_M.
    """

    distance: Scalars
    triangle: Int[np.ndarray, " n"]
    u: Scalars
    v: Scalars


@dataclass(frozen=True)
class Surface:
    """The surface at each hit.

    point: [m]. normal: unit, smooth, towards the viewer. facing: unit, of the triangle, towards
    the viewer. albedo: linear RGB. material: index. facet: hits of equal facet are one surface.
    """

    point: Vectors
    normal: Vectors
    facing: Vectors
    albedo: Vectors
    material: Int[np.ndarray, " n"]
    facet: Int[np.ndarray, " n"]


class World:
    """All triangles of a room. Rays and results are float32."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self.materials: list[Material] = []
        indices: dict[int, int] = {}
        counts, owners = [], []
        for mesh, material in parts:
            if id(material) not in indices:
                indices[id(material)] = len(self.materials)
                self.materials.append(material)
            owners.append(indices[id(material)])
            counts.append(len(mesh.corners))
        whole = join([mesh for mesh, _ in parts])
        self._material = np.repeat(np.array(owners), counts)
        self._facet = whole.facet
        # per triangle: the values at corner 0 and the steps to corners 1 and 2
        values = np.concatenate([whole.normals, whole.uv], axis=2)
        values[:, 1:] -= values[:, :1]
        self._values = np.ascontiguousarray(values)
        edges = whole.corners[:, 1:] - whole.corners[:, :1]
        self._facing = unit(cross(edges[:, 0], edges[:, 1]))
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(whole.corners))

        def gather(name: str) -> Float32[np.ndarray, " materials"]:
            return np.array([getattr(m, name) for m in self.materials], dtype=np.float32)

        self.shininess, self.mirror = gather("shininess"), gather("mirror")
        self.emission, self.glass = gather("emission"), gather("glass") > 0
        self._tint = np.stack([m.tint for m in self.materials]).astype(np.float32)
        self._layer = np.array([m.layer for m in self.materials])
        self._scale, self._turned = gather("tiles_per_m"), gather("turned") > 0
        self._offset = np.array([m.offset for m in self.materials], dtype=np.float32)
        self.backdrop = gather("backdrop") > 0
        self._mean_albedo = mean_albedo(self._layer) * self._tint

    def cast(self, origins: Vectors, directions: Vectors) -> Hits:
        """The first hit of each ray."""
        found = self._scene.run(origins, directions, output=1)
        distance = np.where(found["primID"] >= 0, found["tfar"], np.float32(FAR_M))
        return Hits(distance, found["primID"], found["u"], found["v"])

    def material_of(self, hits: Hits) -> Int[np.ndarray, " n"]:
        """Material index at each hit; of some triangle where a ray met nothing."""
        return np.take(self._material, hits.triangle)

    def blocked(
        self, origins: Vectors, directions: Vectors, reach: Scalars
    ) -> Bool[np.ndarray, " n"]:
        """True where something is nearer than `reach`, in units of the direction."""
        result = self._scene.run(origins, directions, query="OCCLUDED", dists=reach)
        blocked: Bool[np.ndarray, " n"] = result >= 0
        return blocked

    def surface(self, hits: Hits, origins: Vectors, directions: Vectors, spread: float) -> Surface:
        """Surface attributes at the hits.

        spread: width of a pixel at unit distance, which selects the texture's detail. A ray that
        met nothing gets the attributes of some triangle; the caller decides what it shows.
        """
        triangle = hits.triangle
        material = self._material[triangle]
        values = self._values[triangle]
        mixed = values[:, 0] + hits.u[:, None] * values[:, 1] + hits.v[:, None] * values[:, 2]
        point = origins + hits.distance[:, None] * directions
        facing = _towards(self._facing[triangle], directions)
        normal = _towards(unit(mixed[:, :3]), directions)
        uv = self._texture_coordinates(mixed[:, 3:], material, directions)
        slant = -dot(facing, directions) / np.sqrt(dot(directions, directions))
        width = np.float32(spread) * hits.distance / np.sqrt(np.maximum(slant, 0.05))
        footprint = np.where(self.backdrop[material], 0.003, width * self._scale[material])
        albedo = lookup(self._layer[material], uv, footprint) * self._tint[material]
        return Surface(point, normal, facing, albedo, material, self._facet[triangle])

    def plain_surface(self, hits: Hits, origins: Vectors, directions: Vectors) -> Surface:
        """As `surface`, but flat-shaded and with the average colour of each material."""
        triangle = hits.triangle
        material = self._material[triangle]
        point = origins + hits.distance[:, None] * directions
        facing = _towards(self._facing[triangle], directions)
        albedo = self._mean_albedo[material]
        return Surface(point, facing, facing, albedo, material, self._facet[triangle])

    def _texture_coordinates(
        self, uv: Float32[np.ndarray, "n 2"], material: Int[np.ndarray, " n"], directions: Vectors
    ) -> Float32[np.ndarray, "n 2"]:
        uv = np.where(self._turned[material][:, None], uv[:, ::-1], uv)
        uv = uv * self._scale[material][:, None] + self._offset[material]
        far = np.flatnonzero(self.backdrop[material])
        if len(far):
            d = unit(directions[far])
            uv[far, 0] = np.arctan2(d[:, 1], d[:, 0]) * 0.6
            uv[far, 1] = np.clip(0.55 - 0.7 * d[:, 2], 0.01, 0.99)
        return uv


def _towards(normals: Vectors, directions: Vectors) -> Vectors:
    """Normals turned against the directions."""
    away = dot(normals, directions) > 0
    return np.where(away[:, None], -normals, normals)
