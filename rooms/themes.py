"""What kinds of rooms there are and what stands in them."""

from collections.abc import Callable
from dataclasses import dataclass

from rooms import fixtures, seating, storage, tables
from rooms.clutter import floor_thing
from rooms.materials import Generator
from rooms.models import Model

Make = Callable[[Generator], Model]


@dataclass(frozen=True)
class Theme:
    """A kind of room.

    weight: how common it is. sides: ranges of the shorter and longer side [m]. at_walls: what
    stands along the walls, with weights. group: chance of a table with chairs in the middle.
    rows: chance of desks in rows. tiled: chance of tiled walls. density: tries per metre of wall.
    """

    weight: float
    sides: tuple[tuple[float, float], tuple[float, float]]
    at_walls: tuple[tuple[float, Make], ...]
    group: float = 0.0
    rows: float = 0.0
    tiled: float = 0.0
    density: float = 2.4


_ROOM = ((2.6, 5.0), (3.2, 7.5))
_COMMON: tuple[tuple[float, Make], ...] = (
    (0.5, fixtures.plant), (0.6, fixtures.lamp), (0.5, floor_thing), (0.3, fixtures.radiator),
    (0.3, seating.chair), (0.1, fixtures.person), (0.2, fixtures.ladder), (0.3, storage.dresser),
    (0.3, fixtures.clothes_rack),
)  # fmt: skip

THEMES: tuple[Theme, ...] = (
    Theme(  # living room
        3.0, _ROOM,
        ((3.0, seating.sofa), (1.2, tables.tv_stand), (1.5, storage.bookshelf),
         (1.0, storage.dresser), (1.0, tables.table), *_COMMON),
        group=0.5,
    ),
    Theme(  # bedroom
        3.0, _ROOM,
        ((3.0, seating.bed), (1.5, storage.wardrobe), (2.0, storage.dresser),
         (0.8, storage.bookshelf), (0.7, tables.desk), (0.4, seating.sofa), *_COMMON),
    ),
    Theme(  # kitchen and dining room
        2.5, _ROOM,
        ((4.0, storage.kitchen), (2.0, storage.appliance), (1.0, tables.table),
         (0.5, storage.bookshelf), *_COMMON),
        group=0.6, tiled=0.3,
    ),
    Theme(  # office, classroom
        2.0, ((2.8, 6.5), (3.5, 9.5)),
        ((3.0, tables.desk), (2.0, storage.bookshelf), (1.0, storage.appliance),
         (0.8, fixtures.board), (1.5, seating.office_chair), *_COMMON),
        group=0.35, rows=0.4,
    ),
    Theme(  # bathroom
        1.2, ((1.8, 2.6), (2.2, 3.6)),
        ((2.0, fixtures.washbasin), (1.5, fixtures.toilet), (1.5, fixtures.bathtub),
         (0.7, storage.appliance), (0.5, storage.rack), (0.7, fixtures.clothes_rack), *_COMMON),
        tiled=0.6,
    ),
    Theme(  # store room, shop, workshop
        1.2, ((2.2, 6.0), (3.0, 9.0)),
        ((4.0, storage.rack), (2.0, storage.bookshelf), (1.0, storage.appliance),
         (1.0, tables.table), (1.5, floor_thing), *_COMMON),
        group=0.2, density=3.0,
    ),
    Theme(  # corridor
        1.3, ((1.3, 2.2), (4.5, 9.5)),
        ((1.0, storage.dresser), (1.0, storage.wardrobe), (1.0, storage.bookshelf),
         (1.0, floor_thing), (1.0, fixtures.plant), *_COMMON),
        density=1.0,
    ),
)  # fmt: skip
