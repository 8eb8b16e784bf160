"""Building blocks of everything that is read from cell files."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]


class Strict(BaseModel):
    """A part of a cell file: unknown keys and numbers that are not finite are mistakes, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
