"""A few of many values, where more would tell the same."""

from typing import Any, TypeVar

from numpy.typing import NDArray
from torch import Tensor

ENOUGH = 20_000
Values = TypeVar("Values", Tensor, NDArray[Any])


def thinned(values: Values) -> Values:
    """At most ENOUGH of the values along the first axis, evenly spread; a view."""
    return values[:: max(1, -(-len(values) // ENOUGH))]
