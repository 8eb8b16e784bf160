"""Numbers of the fits to known shapes and to known forms, and what each means."""

from dataclasses import dataclass, field

from perception.known_shapes.pose_search import SearchSettings


@dataclass(frozen=True)
class KnownSettings:
    """Settings of the fit.

    Attributes:
        search: The coarse search.
        stride: Every n-th row and column of the pictures is used.
        sparse, dense: Of these every n-th ray is used while hypotheses are many, and while they are few.
        refined: How many places are refined.
        fractions: How many fractions of each joint are tried.
        model_std: What a cell file's sizes, sampling and calibration leave, in [m].
        edges_from: Spread in [m] beyond which faces do not tell the place and edges are asked.
        least_share: Share of the rays that meet the model which must agree with it.
        least_rays: Fewest rays that must agree with it.
        still, still_yaw: What moved by no more than this since an earlier look, in [m] and [rad], stands there still.
        position_prior, yaw_prior, fraction_prior: Spread of what nothing is seen of, in [m], [rad] and 1.
    """

    search: SearchSettings = field(default_factory=SearchSettings)
    stride: int = 4
    sparse: int = 16
    dense: int = 4
    refined: int = 8
    fractions: int = 21
    model_std: float = 0.002
    edges_from: float = 0.003
    least_share: float = 0.9
    least_rays: int = 60
    still: float = 0.015
    still_yaw: float = 0.1
    position_prior: float = 0.05
    yaw_prior: float = 0.2
    fraction_prior: float = 0.5


@dataclass(frozen=True)
class FormSettings:
    """Settings of the fit.

    Attributes:
        yaws: How many yaws the fit is begun from.
        kept: How many of the minima the rays choose among.
        most_points: Points used by the fit.
        most_rays: Rays used to choose.
        model_std: What calibration, sampling and the form itself leave, in [m].
        size_std: Spread of a size as a share of the usual one.
        too_large: A piece larger than the usual sizes by this factor is something else, or more than one thing.
        least_share: Share of the rays that meet the form which must agree with it.
        least_explained: Share of the piece's points which must agree with it.
        least_rays: Fewest rays that must agree with it.
    """

    yaws: int = 8
    kept: int = 3
    most_points: int = 400
    most_rays: int = 1500
    model_std: float = 0.002
    size_std: float = 0.08
    too_large: float = 1.5
    least_share: float = 0.85
    least_explained: float = 0.85
    least_rays: int = 60
