"""A completion as a notebook shows it: pictures and numbers in one piece of HTML."""

from base64 import b64encode
from io import BytesIO

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.pictures.panels import completion_panels

_DPI = 72  # a panel is about 350 pixels wide; the whole stays far below 500 kB
_LEFT = 'style="text-align: left"'


def completion_html(completion: DepthCompletion) -> str:
    """What was believed, the result and its uncertainty, and under them the numbers.

    The picture is part of the text (a data URI): nothing is fetched. Of a batch the first image is
    drawn.
    """
    content = BytesIO()
    completion_panels(completion).savefig(
        content, format="jpeg", dpi=_DPI, pil_kwargs={"quality": 88}
    )
    picture = b64encode(content.getvalue()).decode()
    rows = "".join(
        f"<tr><th {_LEFT}>{name}</th><td {_LEFT}>{value}</td></tr>"
        for name, value in completion.summary().items()
    )
    return (
        '<div><img style="max-width: 100%" alt="believed measurements, result, uncertainty" '
        f'src="data:image/jpeg;base64,{picture}"><table>{rows}</table></div>'
    )
