"""Records scattered over a binary log -> columns, in whole arrays."""

import numpy as np

#: records gathered at a time
_PIECE = 1 << 16


def gather(content: np.ndarray, offsets: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Records of one type that begin at `offsets` (bytes) as a structured array.

    Parameters
    ----------
    content : (bytes,) uint8, the file.
    offsets : (n,) each at most ``len(content) - dtype.itemsize``.
    dtype : layout of a record; its fields may leave bytes out.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.io._rows import gather
    >>> content = np.frombuffer(bytes([9, 1, 0, 9, 9, 2, 1]), np.uint8)
    >>> gather(content, np.array([1, 5]), np.dtype([("value", "<u2")]))["value"]
    array([  1, 258], dtype=uint16)
    """
    if not len(offsets):
        return np.empty(0, dtype)
    windows = np.lib.stride_tricks.sliding_window_view(content, dtype.itemsize)
    out = np.empty(len(offsets), dtype)
    for start in range(0, len(offsets), _PIECE):
        piece = slice(start, start + _PIECE)
        out[piece] = np.ascontiguousarray(windows[offsets[piece]]).view(dtype)[:, 0]
    return out
