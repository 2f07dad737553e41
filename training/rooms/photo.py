"""From linear radiance to the picture a cheap camera would take."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

Radiance = Float32[np.ndarray, "height width 3"]
Picture = UInt8[np.ndarray, "height width 3"]


def photograph(radiance: Radiance, generator: np.random.Generator) -> Picture:
    """Exposure, white balance, blur, vignette, tone curve, noise and JPEG, all at random."""
    height, width = radiance.shape[:2]
    brightness = float(np.median(radiance.mean(axis=2))) + 1e-4
    exposed = radiance * (generator.uniform(0.1, 0.32) / brightness)
    balance = generator.uniform(0.88, 1.14, 3).astype(np.float32)
    exposed = exposed * balance * _vignette(height, width, generator.uniform(0.0, 0.35))
    sigma = generator.uniform(0.35, 0.9) * width / 320
    exposed = cv2.GaussianBlur(exposed, (0, 0), sigma)
    shot = generator.uniform(0.0, 0.025)
    noise = generator.standard_normal(exposed.shape, dtype=np.float32)
    exposed = exposed + shot * noise * np.sqrt(np.maximum(exposed, 0) + 0.02)
    curve = _tone(exposed) ** np.float32(generator.uniform(0.9, 1.15))
    picture = (curve * 255 + 0.5).astype(np.uint8)
    quality = int(generator.integers(50, 98))
    return _jpeg(picture, quality)


def _vignette(height: int, width: int, strength: float) -> Float32[np.ndarray, "height width 1"]:
    y = np.linspace(-1, 1, height, dtype=np.float32)[:, None]
    x = np.linspace(-1, 1, width, dtype=np.float32)[None]
    return (1 - strength * (x * x + y * y) / 2)[..., None]


def _tone(linear: Radiance) -> Radiance:
    """A soft shoulder above 0.6, then the sRGB curve, approximately; 0..1."""
    x = np.maximum(linear, 0)
    x = np.where(x > 0.6, 1 - 0.4 * np.exp(-(x - 0.6) / 0.4), x)
    return np.power(x, np.float32(1 / 2.2))


def _jpeg(picture: Picture, quality: int) -> Picture:
    swapped = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", swapped, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
