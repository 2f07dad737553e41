"""From linear radiance to the picture a cheap camera would take."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

Radiance = Float32[np.ndarray, "height width 3"]
Picture = UInt8[np.ndarray, "height width 3"]


@dataclass(frozen=True, kw_only=True)
class Film:
    """How a camera renders light.

    gain: exposure and white balance, RGB. vignette: loss of light in the corners, 0..1.
    softness: blur [px]. shake: movement during the exposure [px at width 320].
    grain: noise at full exposure, 0..1. shoulder: where highlights start to be compressed, 0..1.
    contrast: exponent. punch: how S-shaped the tone curve is, 0..1. jpeg_quality: 1..100.
    """

    gain: Float[np.ndarray, "3"]
    vignette: float
    softness: float
    shake: tuple[float, float]
    grain: float
    shoulder: float
    contrast: float
    punch: float
    jpeg_quality: int


def choose_film(radiance: Radiance, generator: np.random.Generator) -> Film:
    """A random camera, exposed more or less right for this radiance."""
    brightness = float(np.median(radiance.mean(axis=2))) + 1e-4
    exposure = np.exp(generator.uniform(np.log(0.09), np.log(0.6))) / brightness
    balance = np.exp(generator.normal(0, 0.1) * np.array([1.0, 0.0, -1.4]))
    shaken = generator.random() < 0.12
    shake_x, shake_y = generator.uniform(-3, 3, 2) * shaken
    return Film(
        gain=exposure * balance * generator.uniform(0.95, 1.05, 3),
        vignette=generator.uniform(0.0, 0.35),
        softness=generator.uniform(0.3, 0.65),
        shake=(shake_x, shake_y),
        grain=0.03 * generator.random() ** 2,
        shoulder=generator.uniform(0.4, 0.95),
        contrast=generator.uniform(0.9, 1.4),
        punch=generator.uniform(0.2, 1.0),
        jpeg_quality=int(generator.integers(50, 98)),
    )


def photograph(radiance: Radiance, film: Film, generator: np.random.Generator) -> Picture:
    """The picture as 8-bit RGB; the generator draws the noise."""
    exposed = radiance * film.gain.astype(np.float32) * _vignette(radiance, film.vignette)
    exposed = _blurred(exposed, film)
    noise = generator.standard_normal(exposed.shape, dtype=np.float32)
    exposed += np.float32(film.grain) * noise * np.sqrt(np.maximum(exposed, 0) + 0.02)
    # a soft shoulder for highlights, a gamma curve, an S-curve
    light, start = np.maximum(exposed, 0), np.float32(film.shoulder)
    room = 1 - start
    light = np.where(light > start, 1 - room * np.exp((start - light) / room), light)
    tone = np.power(light, np.float32(film.contrast / 2.2))
    tone += np.float32(film.punch) * (tone * tone * (3 - 2 * tone) - tone)
    return _jpeg((tone * 255 + 0.5).astype(np.uint8), film.jpeg_quality)


def _vignette(radiance: Radiance, strength: float) -> Float32[np.ndarray, "height width 1"]:
    y = np.linspace(-1, 1, radiance.shape[0], dtype=np.float32)[:, None]
    x = np.linspace(-1, 1, radiance.shape[1], dtype=np.float32)[None]
    darkening: Float32[np.ndarray, "height width"] = 1 - np.float32(strength / 2) * (x * x + y * y)
    return darkening[..., None]


def _blurred(image: Radiance, film: Film) -> Radiance:
    """A slightly soft lens, which also smooths stair-steps, and the movement of the hand."""
    blurred = cv2.GaussianBlur(image, (0, 0), film.softness)
    if any(film.shake):
        pixel = image.shape[1] / 320
        reach = int(np.ceil(3 * pixel))
        kernel = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.float32)
        dx, dy = (round(v * pixel) for v in film.shake)
        cv2.line(kernel, (reach - dx, reach - dy), (reach + dx, reach + dy), 1.0)
        blurred = cv2.filter2D(blurred, -1, kernel / kernel.sum())
    return np.asarray(blurred, dtype=np.float32)


def _jpeg(picture: Picture, quality: int) -> Picture:
    """The picture after compression and decompression."""
    swapped = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", swapped, [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert decoded is not None  # it was encoded just now
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB), dtype=np.uint8)
