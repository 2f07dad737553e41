"""What surfaces are made of."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float32

from rooms.bank import layers
from rooms.textures import random_colour

Generator = np.random.Generator
Colour = Float32[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class Material:
    """One material of a scene.

    layer: of the texture bank. tint: linear RGB factor on the texture. tiles_per_m: how often the
    texture repeats. shininess: strength of the highlight, 0..1. mirror: part of the light that is
    reflected as in a mirror, 0..1. emission: radiance for albedo 1. glass: a depth sensor sees
    through it. backdrop: the texture is looked up by viewing direction, as at infinity.
    """

    layer: int
    tint: Colour
    tiles_per_m: float = 1.0
    turned: bool = False
    shininess: float = 0.0
    mirror: float = 0.0
    emission: float = 0.0
    glass: bool = False
    backdrop: bool = False
    offset: tuple[float, float] = field(default=(0.0, 0.0))


def _textured(
    generator: Generator, kind: str, tint: Colour, tile_m: tuple[float, float]
) -> Material:
    """A random layer of a kind, at a random size, place and quarter turn."""
    return Material(
        layer=int(generator.choice(layers(kind))),
        tint=tint,
        tiles_per_m=1.0 / generator.uniform(*tile_m),
        turned=bool(generator.random() < 0.5),
        offset=(float(generator.random()), float(generator.random())),
    )


def _grey(generator: Generator, low: float, high: float) -> Colour:
    """A nearly neutral reflectance."""
    return random_colour(generator, value=(low, high), saturation=0.15)


def _any_colour(generator: Generator, low: float = 0.04, high: float = 0.9) -> Colour:
    return random_colour(generator, value=(low, high), saturation=0.9)


def paint(generator: Generator) -> Material:
    """Wall paint: mostly light and plain; sometimes wallpaper, bricks or tiles."""
    draw = generator.random()
    if draw < 0.6:
        cream = np.array([1.0, 0.93, 0.8]) ** generator.uniform(-0.3, 1.6)
        tint = (cream * generator.uniform(0.45, 0.95)).astype(np.float32)
        return _textured(generator, "plaster", tint, (0.5, 3.0))
    if draw < 0.82:
        tint = random_colour(generator, value=(0.2, 0.9), saturation=0.7)
        return _textured(generator, "plaster", tint, (0.5, 3.0))
    if draw < 0.88:
        tint = random_colour(generator, value=(0.7, 1.0), saturation=0.3)
        return _textured(generator, "print", tint, (0.4, 1.5))
    if draw < 0.91:
        stripes = _textured(generator, "stripes", _grey(generator, 0.7, 1.0), (0.5, 1.5))
        return replace(stripes, turned=False)
    if draw < 0.95:
        tint = random_colour(generator, value=(0.4, 0.9), saturation=0.5)
        return replace(_textured(generator, "bricks", tint, (0.6, 1.0)), turned=False)
    return wall_tiles(generator)


def wall_tiles(generator: Generator) -> Material:
    """Tiles of bathrooms and kitchens."""
    tiles = _textured(generator, "tiles", _grey(generator, 0.7, 1.0), (0.3, 0.9))
    return replace(tiles, mirror=0.04, shininess=0.5)


def ceiling(generator: Generator) -> Material:
    """Mostly white; sometimes panels or wood."""
    draw = generator.random()
    tint = _grey(generator, 0.7, 0.95)
    if draw < 0.75:
        return _textured(generator, "plaster", tint, (0.5, 3.0))
    if draw < 0.92:
        return _textured(generator, "tiles", tint, (0.6, 2.0))
    return wood(generator, kind="planks")


def floor(generator: Generator) -> Material:
    """Wood, tiles or wall-to-wall carpet."""
    draw = generator.random()
    if draw < 0.45:
        boards = wood(generator, kind="planks")
        return replace(boards, mirror=float(0.12 * generator.random() ** 2), shininess=0.3)
    if draw < 0.7:
        tiles = _textured(generator, "tiles", _grey(generator, 0.3, 1.0), (0.5, 1.6))
        return replace(tiles, mirror=float(0.15 * generator.random() ** 2), shininess=0.4)
    tint = random_colour(generator, value=(0.08, 0.8), saturation=0.5)
    return _textured(
        generator, str(generator.choice(["weave", "plaster", "blotches"])), tint, (0.3, 1.0)
    )


def wood(generator: Generator, kind: str = "wood") -> Material:
    """Brown woods from light to nearly black, and painted boards."""
    if generator.random() < 0.3:
        tint = _grey(generator, 0.5, 1.0)
    else:
        depth = 0.08 + 0.92 * generator.random() ** 1.5
        tint = np.array([0.85, 0.55, 0.3]) * depth + np.array([0.1, 0.1, 0.1]) * depth**2
        tint = (tint * generator.uniform(0.85, 1.1, 3)).astype(np.float32)
    made = _textured(generator, kind, tint, (0.4, 1.2) if kind == "wood" else (0.5, 1.2))
    return replace(made, shininess=float(generator.uniform(0, 0.4)))


def fabric(generator: Generator) -> Material:
    """Upholstery, bedding, curtains."""
    draw = generator.random()
    if draw < 0.55:
        tint = random_colour(generator, value=(0.04, 0.9), saturation=0.7)
        return _textured(generator, "weave", tint, (0.15, 0.5))
    kind = str(generator.choice(["stripes", "print", "blotches"]))
    return _textured(generator, kind, _grey(generator, 0.6, 1.0), (0.25, 1.2))


def carpet(generator: Generator) -> Material:
    """A rug; texture coordinates 0..1 over its size."""
    made = _textured(generator, "carpet", _grey(generator, 0.5, 1.0), (1.0, 1.0))
    return replace(made, offset=(0.0, 0.0))


def plastic(generator: Generator) -> Material:
    """Smooth, any colour; also lacquered boards and ceramics."""
    tint = _any_colour(generator) if generator.random() < 0.6 else _grey(generator, 0.03, 0.95)
    made = _textured(generator, "plaster", tint, (0.5, 2.0))
    return replace(made, shininess=float(generator.uniform(0.2, 0.9)), mirror=0.03)


def ceramic(generator: Generator) -> Material:
    """White and shiny."""
    made = _textured(generator, "plaster", _grey(generator, 0.75, 0.95), (0.5, 2.0))
    return replace(made, shininess=0.8, mirror=0.04)


def skin(generator: Generator) -> Material:
    """From light to dark."""
    tint = np.array([0.8, 0.5, 0.38]) * generator.uniform(0.2, 1.0)
    return _textured(generator, "plaster", tint.astype(np.float32), (0.5, 1.0))


def metal(generator: Generator) -> Material:
    """Steel, brass, black iron."""
    made = _textured(generator, "plaster", _grey(generator, 0.02, 0.7), (0.3, 1.0))
    return replace(made, shininess=1.0, mirror=float(generator.uniform(0.0, 0.5)))


def dark_gloss(generator: Generator) -> Material:
    """A switched-off screen, a black lacquered or glass front."""
    made = _textured(generator, "plaster", _grey(generator, 0.01, 0.04), (1.0, 2.0))
    return replace(made, shininess=0.9, mirror=float(generator.uniform(0.05, 0.15)))


def mirror(generator: Generator) -> Material:
    """A looking glass: it has the depth of its surface."""
    made = _textured(generator, "plaster", np.full(3, 0.05, np.float32), (1.0, 2.0))
    return replace(made, shininess=1.0, mirror=float(generator.uniform(0.75, 0.95)), glass=True)


def window_pane(generator: Generator, brightness: float) -> Material:
    """Glass in front of an outdoor backdrop."""
    made = _textured(generator, "outdoors", np.ones(3, np.float32), (1.0, 1.0))
    return replace(
        made,
        turned=False,
        shininess=0.5,
        mirror=0.06,
        emission=brightness,
        glass=True,
        backdrop=True,
    )


def emitter(tint: Colour, radiance: float) -> Material:
    """A lamp's glowing surface."""
    return Material(layer=layers("plaster")[0], tint=tint, emission=radiance)


def picture(generator: Generator) -> Material:
    """A painting, photograph, poster or page; texture coordinates 0..1 over its size."""
    kind = str(generator.choice(["art", "art", "page", "print"]))
    made = _textured(generator, kind, _grey(generator, 0.6, 1.0), (1.0, 1.0))
    return replace(made, turned=False, shininess=float(generator.choice([0.0, 0.6])))


def screen(generator: Generator) -> Material:
    """A switched-on screen."""
    made = picture(generator)
    return replace(made, emission=float(generator.uniform(0.2, 1.0)), shininess=0.6, mirror=0.04)


def printed(generator: Generator) -> Material:
    """Packaging, book covers, toys: small strong patterns."""
    kind = str(generator.choice(["page", "art", "print", "stripes", "weave"]))
    made = _textured(generator, kind, _any_colour(generator, 0.4, 1.0), (0.1, 0.6))
    return replace(made, shininess=float(generator.uniform(0, 0.6)))


def leaf(generator: Generator) -> Material:
    """Plant green."""
    tint = np.array([0.15, 0.4, 0.08]) * generator.uniform(0.4, 1.4, 3)
    return replace(_textured(generator, "wood", tint.astype(np.float32), (0.1, 0.3)), shininess=0.3)


def sky(generator: Generator, brightness: float) -> Material:
    """The open sky, looked up by direction."""
    made = _textured(generator, "sky", np.ones(3, np.float32), (1.0, 1.0))
    return replace(made, turned=False, emission=brightness, backdrop=True)


def asphalt(generator: Generator) -> Material:
    """Roads and pavements: grey, rough or in slabs."""
    kind = str(generator.choice(["plaster", "plaster", "weave", "tiles", "bricks"]))
    return _textured(generator, kind, _grey(generator, 0.06, 0.4), (0.8, 4.0))


def road_paint(generator: Generator) -> Material:
    """White lines, more or less worn."""
    return _textured(generator, "plaster", _grey(generator, 0.5, 0.95), (0.5, 2.0))


def facade(generator: Generator) -> Material:
    """Render, brick or stone."""
    kind = str(generator.choice(["plaster", "plaster", "bricks", "tiles", "planks"]))
    tint = random_colour(generator, value=(0.15, 0.85), saturation=0.45)
    return replace(_textured(generator, kind, tint, (1.0, 4.0)), turned=False)


def roof(generator: Generator) -> Material:
    """Red, brown or grey tiles."""
    tint = np.array([0.5, 0.25, 0.16]) ** generator.uniform(0.3, 1.3) * generator.uniform(0.3, 1.0)
    return _textured(generator, "planks", tint.astype(np.float32), (0.5, 2.0))
