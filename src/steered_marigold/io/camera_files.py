"""The many forms in which cameras are written down, each read into one record."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import yaml

from steered_marigold.core.notices import Notice, Notices
from steered_marigold.errors import FileFormatError
from steered_marigold.io.files import AnyPath, decoding, load_array, require_file


@dataclass(frozen=True, kw_only=True)
class Camera:
    """matrix: K row by row. size: (height, width) [px]. distortion: k1, k2, p1, p2, k3 ..."""

    matrix: list[float]
    size: tuple[int, int] | None = None
    distortion: list[float] | None = None
    notes: Notices = ()


# COLMAP's models: which parameters are fx, fy, cx, cy, and OpenCV's coefficients after them
_COLMAP: dict[str, tuple[tuple[int, int, int, int], int]] = {
    "SIMPLE_PINHOLE": ((0, 0, 1, 2), 0),
    "PINHOLE": ((0, 1, 2, 3), 0),
    "SIMPLE_RADIAL": ((0, 0, 1, 2), 1),
    "RADIAL": ((0, 0, 1, 2), 2),
    "OPENCV": ((0, 1, 2, 3), 4),
    "FULL_OPENCV": ((0, 1, 2, 3), 8),
}
_KITTI = ("P2", "P_rect_02", "P_rect_2")
_MATRIX_KEYS = ("camera_matrix", "intrinsic_matrix", "K", "k", "cameraMatrix", "intrinsics", "cam0")
_FOCAL_X = ("fx", "fl_x", "fx_color", "Fx", "focal_length_x")
_FOCAL_Y = ("fy", "fl_y", "fy_color", "Fy", "focal_length_y")
_CENTRE_X = ("cx", "ppx", "mx_color", "PPx", "principal_point_x")
_CENTRE_Y = ("cy", "ppy", "my_color", "PPy", "principal_point_y")
_WIDTHS = ("image_width", "width", "w", "colorWidth", "Resolution x")
_HEIGHTS = ("image_height", "height", "h", "colorHeight", "Resolution y")
_DISTORTIONS = (
    "distortion_coefficients", "distortion_coeffs", "coeffs", "D", "d", "dist_coeffs", "distCoeffs"
)  # fmt: skip
_ORB_SLAM = r"^Camera1?\."
_PINHOLE_MODELS = ("plumb_bob", "rational_polynomial", "radtan", "radial-tangential", "")


def parse_camera(text: str) -> Camera:
    """The camera in the text of a file, or in fx,fy,cx,cy; FileFormatError if there is none."""
    lines = [line.split("#")[0].strip() for line in text.splitlines()]
    body = "\n".join(line for line in lines if line)
    if (numbers := parse_numbers(body)) is not None:
        return _from_numbers(numbers)
    if (colmap := _colmap_lines(body)) and len({line.split(maxsplit=1)[1] for line in colmap}) == 1:
        return _from_colmap(colmap[0])
    if colmap:
        raise FileFormatError(
            f"holds {len(colmap)} cameras that differ; keep the line of the image's camera"
        )
    fields = _fields(text, body)
    if not fields:
        raise FileFormatError(
            "intrinsics are fx,fy,cx,cy, a 3x3 K, or a camera file of ROS, Open3D, RealSense, "
            "ScanNet, KITTI, COLMAP, TUM, ORB-SLAM or Middlebury; this is none of them"
        )
    return _from_fields(fields)


def camera_text(source: AnyPath) -> str:
    """Numbers as they were typed, or the text of a file; FileFormatError if there is none."""
    if parse_numbers(str(source)) is not None:
        return str(source)
    path = require_file(source)
    if path.suffix.lower() == ".npy":
        return " ".join(map(str, load_array(path).flatten().tolist()))
    with decoding(path):
        return path.read_text(encoding="utf-8-sig")


def parse_numbers(text: str) -> list[float] | None:
    """Finite numbers separated by blanks, commas and brackets; None if anything else is there."""
    try:
        numbers = [float(word) for word in re.split(r"[\s,;\[\]]+", text) if word]
    except ValueError:
        return None
    return numbers if numbers and all(map(isfinite, numbers)) else None


def _from_numbers(numbers: list[float]) -> Camera:
    """By how many there are: four, a matrix of 3x3, 3x4 or 4x4, each with or without a size."""
    count = len(numbers)
    if count in (4, 6, 8, 9, 11) and not _is_matrix(numbers[:9]):
        rest = numbers[4:]
        if count == 6 and all(value >= 2 and value == int(value) for value in rest):
            return Camera(matrix=_square(numbers), size=(int(rest[1]), int(rest[0])))
        if count in (4, 8, 9):  # k1 k2 p1 p2, and k3
            return Camera(matrix=_square(numbers), distortion=rest or None)
    elif count in (9, 11) and _is_matrix(numbers):
        size = (int(numbers[10]), int(numbers[9])) if count == 11 else None
        return Camera(matrix=numbers[:9], size=size)
    elif count in (12, 16) and (count == 12 or numbers[12:] == [0, 0, 0, 1]):
        return Camera(matrix=[numbers[4 * row + column] for row in range(3) for column in range(3)])
    raise FileFormatError(
        f"{count} numbers are no intrinsics: give fx fy cx cy, with width height after them if "
        "known, or a 3x3 K"
    )


def _is_matrix(numbers: Sequence[float]) -> bool:
    """Whether 9 numbers are a 3x3 K; fx fy cx cy and five coefficients do not end in 0 0 1."""
    return len(numbers) >= 9 and (list(numbers[6:9]) == [0, 0, 1] or numbers[1] == 0)


def _square(four: Sequence[float]) -> list[float]:
    fx, fy, cx, cy = four[:4]
    return [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]


def _colmap_lines(body: str) -> list[str]:
    """Lines as "1 PINHOLE 640 480 460 460 320 240"."""
    return [line for line in body.splitlines() if re.match(r"\d+\s+[A-Z_]+\s+\d+\s+\d+\s", line)]


def _from_colmap(line: str) -> Camera:
    _, model, width, height, *words = line.split()
    parameters = parse_numbers(" ".join(words))
    if model not in _COLMAP or parameters is None:
        raise FileFormatError(
            f"the COLMAP model {model} cannot be read; use one of {', '.join(_COLMAP)}"
        )
    places, coefficients = _COLMAP[model]
    first = max(places) + 1
    if len(parameters) != first + coefficients:
        raise FileFormatError(f"{model} has {first + coefficients} parameters")
    fx, fy, cx, cy = (parameters[place] for place in places)
    text = "COLMAP counts from the image's corner, so half a pixel was taken off its cx and cy."
    return Camera(
        matrix=_square([fx, fy, cx - 0.5, cy - 0.5]),
        size=(int(height), int(width)),
        distortion=parameters[first:] or None,
        notes=(Notice("half_pixel", text),),
    )


def _fields(text: str, body: str) -> dict[str, Any]:
    """The mapping that JSON, YAML, or lines as "name: value", "name = value", "name,value" hold."""
    if text.lstrip().startswith("{"):
        data = _json(text)
    elif matches := re.findall(r"^([\w .]+?)\s*[:=,]\s*([-+\d\[.][-+\d.eE\s,;\[\]]*)$", body, re.M):
        data = {name: _value(value) for name, value in matches if _value(value) is not None}
        data = data if _find(data, (*_KITTI, "cam0", *_FOCAL_X)) is not None else _yaml(text)
    else:
        data = _yaml(text)
    if not isinstance(data, dict):
        return {}
    return {re.sub(_ORB_SLAM, "", str(name)): value for name, value in data.items()}


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise FileFormatError(f"no JSON ({error})") from error


def _value(text: str) -> float | list[float] | None:
    numbers = parse_numbers(text)
    return numbers[0] if numbers and len(numbers) == 1 else numbers


def _yaml(text: str) -> Any:
    """The first document; OpenCV's tags and header are no YAML that others read."""
    text = re.sub(r"^%YAML.*$", "", text, flags=re.M).replace("!!opencv-matrix", "")
    try:
        return next(iter(yaml.safe_load_all(text)), None)
    except yaml.YAMLError as error:
        raise FileFormatError(f"neither numbers nor YAML ({error.__class__.__name__})") from error


def _from_fields(fields: Mapping[str, Any]) -> Camera:
    """A camera from named values, which may lie one level deeper, as in Kalibr's cam0."""
    if (projection := _find(fields, _KITTI)) is not None:
        size = _find(fields, ("S_rect_02", "S_rect_2"))
        camera = _from_numbers(projection)
        return Camera(matrix=camera.matrix, size=size and (int(size[1]), int(size[0])))
    inner = [value for value in fields.values() if isinstance(value, Mapping)]
    if not _has_camera(fields):
        inner = [value for value in inner if _has_camera(value)]
        if len(inner) != 1:
            raise FileFormatError("names no fx, fy, cx, cy, and no camera matrix")
        fields = inner[0]
    return Camera(
        matrix=_matrix(fields),
        size=_size(fields),
        distortion=_distortion(fields),
        notes=_middlebury_notes(fields),
    )


def _has_camera(fields: Mapping[str, Any]) -> bool:
    return _find(fields, _FOCAL_X) is not None or (
        _numbers_of(_find(fields, _MATRIX_KEYS)) is not None
    )


def _matrix(fields: Mapping[str, Any]) -> list[float]:
    found = [_find(fields, names) for names in (_FOCAL_X, _FOCAL_Y, _CENTRE_X, _CENTRE_Y)]
    if found[0] is not None:
        found[1] = found[0] if found[1] is None else found[1]
        if None in found:
            raise FileFormatError("names no cx or cy")
        return _square([float(value) for value in found])
    numbers = _numbers_of(_find(fields, _MATRIX_KEYS)) or []
    if len(numbers) == 9 and numbers[2] == numbers[5] == 0 and any(numbers[6:8]):
        numbers = [numbers[3 * row + column] for column in range(3) for row in range(3)]
    return _from_numbers(numbers).matrix


def _size(fields: Mapping[str, Any]) -> tuple[int, int] | None:
    width, height = _find(fields, _WIDTHS), _find(fields, _HEIGHTS)
    if (resolution := _numbers_of(fields.get("resolution"))) and len(resolution) == 2:
        width, height = resolution
    return None if not width or not height else (int(height), int(width))


def _distortion(fields: Mapping[str, Any]) -> list[float] | None:
    """OpenCV's coefficients, if the model is OpenCV's."""
    model = str(fields.get("distortion_model") or "").lower()
    if "KannalaBrandt" in str(fields.get("type")):
        model = "KannalaBrandt"
    if model not in _PINHOLE_MODELS:
        raise FileFormatError(f"the distortion model {model} is no pinhole camera's; undistort it")
    named = [fields.get(name) for name in ("k1", "k2", "p1", "p2", "k3")]
    if any(named):
        return [float(value or 0) for value in named]
    return _numbers_of(_find(fields, _DISTORTIONS))


def _middlebury_notes(fields: Mapping[str, Any]) -> Notices:
    offset = fields.get("doffs")
    if not isinstance(offset, float) or offset == 0:
        return ()
    text = f"The file's doffs = {offset:g} is not used; add it to the disparities beforehand."
    return (Notice("disparity_offset", text),)


def _find(fields: Mapping[str, Any], names: Sequence[str]) -> Any:
    """The value of the first of the names that is there, else None."""
    return next((fields[name] for name in names if fields.get(name) is not None), None)


def _numbers_of(value: Any) -> list[float] | None:
    """Flat numbers of a list, of rows, or of a mapping with `data`, as ROS and OpenCV have it."""
    if isinstance(value, Mapping):
        value = value.get("data")
    if not isinstance(value, list) or not value:
        return None
    flat = [cell for row in value for cell in (row if isinstance(row, list) else [row])]
    return [float(cell) for cell in flat] if all(_is_number(cell) for cell in flat) else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
