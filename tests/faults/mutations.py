"""Damage to files: bytes replaced, inserted, removed, cut off or repeated."""

from hypothesis import strategies as st

Edit = tuple[str, float, bytes]

# digits and brackets reach deep into text formats, the rest into headers and data
_BYTES = st.one_of(
    st.binary(min_size=1, max_size=8),
    st.text('0123456789-.eE"[]{},: nul', min_size=1, max_size=8).map(str.encode),
)
edits = st.lists(
    st.tuples(
        st.sampled_from(("replace", "insert", "remove", "cut", "repeat")),
        st.floats(0, 1).map(lambda x: x * x),  # headers are at the beginning
        _BYTES,
    ),
    min_size=1,
    max_size=4,
)


def damaged(content: bytes, changes: list[Edit]) -> bytes:
    """The content after the changes."""
    for kind, where, data in changes:
        at = int(where * len(content))
        end = at + len(data)
        if kind == "replace":
            content = content[:at] + data + content[end:]
        elif kind == "insert":
            content = content[:at] + data + content[at:]
        elif kind == "remove":
            content = content[:at] + content[end:]
        elif kind == "cut":
            content = content[:at]
        else:
            content = content[:at] + content[at:end] * 40 + content[at:]
    return content
