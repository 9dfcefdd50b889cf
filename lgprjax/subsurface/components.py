"""The few directions in which a map's coefficients hold their power."""

import numpy as np
from jaxtyping import Float


def leading_components(
    coefficients: Float[np.ndarray, "trace coefficient"], share: float
) -> Float[np.ndarray, "coefficient component"]:
    """Fewest leading eigenvectors that hold a share of the power of a map's traces; their number a multiple of 8."""
    value, vector = np.linalg.eigh(coefficients.T.astype(np.float64) @ coefficients)
    held = np.cumsum(value[::-1]) / max(float(np.sum(value)), 1e-30)
    enough = 1 + int(np.searchsorted(held, share))
    count = min(8 * -(-enough // 8), coefficients.shape[1])
    return np.ascontiguousarray(vector[:, ::-1][:, :count]).astype(np.float32)
