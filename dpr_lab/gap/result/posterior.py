"""Sets of effects that could be the cause, each as fitted, with what its values may be off by."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(allow_inf_nan=False)]


class PosteriorComponent(BaseModel):
    """One set of effects, as fitted: a normal distribution of its values, and the probability of the set."""

    model_config = ConfigDict(extra="ignore", frozen=True, defer_build=True)

    probability: Annotated[float, Field(ge=0, le=1)]
    """Among the sets that were fitted; that of a cause outside the library is not in it."""
    ratios: dict[str, Number]
    """a/b, d/b, e1/b, c1/b, c2/b."""
    effects: dict[str, dict[str, Number]]
    """Effect -> parameter -> value, SI, at the b of the diagnosis."""
    free: list[str]
    """Fitted values, in the order of the covariance: a ratio, or `effect.parameter`."""
    covariance: list[list[Number]]
    """(free, free), SI."""
