"""JSON for pages: it knows no NaN."""

import json
import math
from typing import Any


def finite_json(value: dict[str, Any]) -> bytes:
    """As JSON: what is no number is null, the others have four digits after the point."""
    return json.dumps(_finite(value)).encode()


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    return value
