"""From linear radiance to the picture a cheap camera would take."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

Radiance = Float32[np.ndarray, "height width 3"]
Picture = UInt8[np.ndarray, "height width 3"]


def photograph(radiance: Radiance, generator: np.random.Generator) -> Picture:
    """Exposure, white balance, vignette, blur, noise, tone curve and JPEG, all at random."""
    height, width = radiance.shape[:2]
    brightness = float(np.median(radiance.mean(axis=2))) + 1e-4
    exposure = np.exp(generator.uniform(np.log(0.1), np.log(0.6))) / brightness
    balance = np.exp(generator.normal(0, 0.1) * np.array([1.0, 0.0, -1.4]))
    balance = balance * generator.uniform(0.95, 1.05, 3)
    vignette = _vignette(height, width, generator.uniform(0.0, 0.35))
    exposed = _blurred(radiance * (exposure * balance).astype(np.float32) * vignette, generator)
    grain = 0.03 * generator.random() ** 2
    noise = generator.standard_normal(exposed.shape, dtype=np.float32)
    exposed += np.float32(grain) * noise * np.sqrt(np.maximum(exposed, 0) + 0.02)
    shoulder, contrast = generator.uniform(0.4, 0.95), generator.uniform(0.9, 1.5)
    picture = (_tone(exposed, shoulder=shoulder, contrast=contrast) * 255 + 0.5).astype(np.uint8)
    return _jpeg(picture, quality=int(generator.integers(50, 98)))


def _vignette(height: int, width: int, strength: float) -> Float32[np.ndarray, "height width 1"]:
    y = np.linspace(-1, 1, height, dtype=np.float32)[:, None]
    x = np.linspace(-1, 1, width, dtype=np.float32)[None]
    return (1 - np.float32(strength) * (x * x + y * y) / 2)[..., None]


def _blurred(image: Radiance, generator: np.random.Generator) -> Radiance:
    """A slightly soft lens, which also smooths stair-steps; sometimes a shaken hand."""
    pixel = image.shape[1] / 320
    blurred = cv2.GaussianBlur(image, (0, 0), generator.uniform(0.3, 0.65) * pixel)
    if generator.random() < 0.12:
        reach = int(np.ceil(3 * pixel))
        kernel = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.float32)
        dx, dy = (int(v) for v in np.round(generator.uniform(-3, 3, 2) * pixel))
        cv2.line(kernel, (reach - dx, reach - dy), (reach + dx, reach + dy), 1.0)
        blurred = cv2.filter2D(blurred, -1, kernel / kernel.sum())
    return blurred


def _tone(linear: Radiance, *, shoulder: float, contrast: float) -> Radiance:
    """Linear light to 0..1: soft above the shoulder, then a gamma curve and contrast."""
    x = np.maximum(linear, 0)
    room = np.float32(1 - shoulder)
    x = np.where(x > shoulder, 1 - room * np.exp((np.float32(shoulder) - x) / room), x)
    return np.power(x, np.float32(contrast / 2.2))


def _jpeg(picture: Picture, *, quality: int) -> Picture:
    swapped = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", swapped, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
