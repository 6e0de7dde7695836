"""Registers an observed point cloud to a model, and says how likely the pose is right."""

from collections.abc import Iterable, Sequence
from os import PathLike
from typing import Any, Literal, Union, final

from numpy import float32, float64
from numpy.typing import ArrayLike, NDArray

__version__: str
__all__ = [
    "Axis",
    "CloudError",
    "Error",
    "Fold",
    "Mesh",
    "Other",
    "Policy",
    "PolicyError",
    "Registrar",
    "Registration",
    "Slide",
    "Step",
    "Tracker",
    "Undetermined",
    "__version__",
    "evaluate",
    "points_of_depth",
    "refine",
    "register",
    "register_batch",
    "register_depth",
    "verify",
]

_Mode = Literal["fast", "polish", "verify", "refine", "best"]
_Dense = Literal["auto", "always", "never"]
_Verdict = Literal[
    "converged", "step limit", "oscillating", "out of range", "poor fit", "sizes differ", "too few points", "mirrored"
]
_Cloud = Union[ArrayLike, "Mesh"]
_Start = Union[ArrayLike, Literal["identity", "anywhere"], None]
_Starts = Union[_Start, Sequence[Union[ArrayLike, str]]]

class Error(ValueError): ...
class CloudError(Error): ...
class PolicyError(Error): ...

@final
class Policy:
    @staticmethod
    def pretrained(name: Literal["reagent", "int8", "compact", "views", "views-compact"] = "reagent") -> Policy: ...
    @staticmethod
    def load(path: str | PathLike[str]) -> Policy: ...
    @property
    def name(self) -> str: ...
    @property
    def format(self) -> Literal["f32", "int8"]: ...
    @property
    def sha256(self) -> str: ...

@final
class Registration:
    @property
    def target_from_source(self) -> NDArray[float64]: ...
    @property
    def verdict(self) -> _Verdict: ...
    @property
    def converged(self) -> bool: ...
    @property
    def probability(self) -> float | None: ...
    @property
    def overlap(self) -> float | None: ...
    @property
    def rmse(self) -> float | None: ...
    @property
    def extents_ratio(self) -> float | None: ...
    @property
    def undetermined(self) -> Undetermined | None: ...
    @property
    def covariance(self) -> NDArray[float64] | None: ...
    @property
    def covariance_about(self) -> NDArray[float64] | None: ...
    @property
    def state(self) -> Literal["found", "tracked", "lost"] | None: ...
    @property
    def start(self) -> int | None: ...
    @property
    def others(self) -> list[Other]: ...
    @property
    def steps(self) -> list[Step]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def ms(self) -> float: ...
    def to_dict(self) -> dict[str, Any]: ...
    def __copy__(self) -> Registration: ...
    def __deepcopy__(self, _memo: Any, /) -> Registration: ...

@final
class Other:
    @property
    def target_from_source(self) -> NDArray[float64]: ...
    @property
    def probability(self) -> float: ...
    @property
    def overlap(self) -> float: ...
    @property
    def rmse(self) -> float: ...

@final
class Undetermined:
    @property
    def axis(self) -> Axis | None: ...
    @property
    def any_rotation(self) -> bool: ...
    @property
    def fold(self) -> Fold | None: ...
    @property
    def slide(self) -> Slide | None: ...
    @property
    def poses(self) -> NDArray[float64]: ...
    def __bool__(self) -> bool: ...

@final
class Fold:
    @property
    def point(self) -> NDArray[float64]: ...
    @property
    def direction(self) -> NDArray[float64]: ...
    @property
    def order(self) -> int: ...

@final
class Axis:
    @property
    def point(self) -> NDArray[float64]: ...
    @property
    def direction(self) -> NDArray[float64]: ...
    @property
    def range_deg(self) -> tuple[float, float]: ...

@final
class Slide:
    @property
    def direction(self) -> NDArray[float64]: ...
    @property
    def range(self) -> tuple[float, float]: ...

@final
class Step:
    @property
    def number(self) -> int: ...
    @property
    def translation(self) -> NDArray[float64]: ...
    @property
    def rotation_rad(self) -> NDArray[float64]: ...
    @property
    def translation_id(self) -> tuple[int, int, int]: ...
    @property
    def rotation_id(self) -> tuple[int, int, int]: ...
    @property
    def translation_probability(self) -> NDArray[float32] | None: ...
    @property
    def rotation_probability(self) -> NDArray[float32] | None: ...
    @property
    def target_from_source(self) -> NDArray[float64]: ...

@final
class Mesh:
    def __new__(cls, vertices: ArrayLike, faces: ArrayLike) -> Mesh: ...

@final
class Tracker:
    def __new__(
        cls,
        target: _Cloud,
        init: _Start = None,
        mode: Literal["polish", "verify", "refine", "best"] = "verify",
        viewpoint: ArrayLike | None = None,
        *,
        policy: Policy | None = None,
        steps: int = 10,
        points: int = 1024,
    ) -> Tracker: ...
    def follow(self, source: _Cloud) -> Registration: ...
    @property
    def policy(self) -> Policy: ...

@final
class Registrar:
    def __new__(cls, policy: Policy | None = None, *, threads: int | None = None) -> Registrar: ...
    @property
    def policy(self) -> Policy | None: ...
    def register(
        self,
        source: _Cloud,
        target: _Cloud,
        init: _Starts = None,
        mode: _Mode = "verify",
        viewpoint: ArrayLike | None = None,
        *,
        steps: int = 10,
        points: int | None = None,
        dense: _Dense = "auto",
        best: int = 1,
    ) -> Registration: ...
    def register_depth(
        self,
        depth: ArrayLike,
        camera: ArrayLike,
        target: _Cloud,
        init: _Starts = None,
        mode: _Mode = "verify",
        *,
        mask: ArrayLike | None = None,
        depth_scale: float = 1.0,
        steps: int = 10,
        points: int | None = None,
        dense: _Dense = "auto",
        best: int = 1,
    ) -> Registration: ...
    def refine(
        self,
        source: _Cloud,
        target: _Cloud,
        init: _Starts = None,
        viewpoint: ArrayLike | None = None,
        *,
        points: int | None = None,
        dense: _Dense = "auto",
        best: int = 1,
    ) -> Registration: ...
    def verify(
        self,
        source: _Cloud,
        target: _Cloud,
        init: _Starts = None,
        viewpoint: ArrayLike | None = None,
        *,
        points: int | None = None,
        dense: _Dense = "auto",
        best: int = 1,
    ) -> Registration: ...
    def register_batch(
        self,
        sources: Iterable[_Cloud] | _Cloud,
        targets: Iterable[_Cloud] | _Cloud,
        init: _Start = None,
        mode: _Mode = "verify",
        viewpoint: ArrayLike | None = None,
        *,
        steps: int = 10,
        points: int | None = None,
        dense: _Dense = "auto",
        best: int = 1,
        return_exceptions: bool = False,
    ) -> list[Any]: ...

def register(
    source: _Cloud,
    target: _Cloud,
    init: _Starts = None,
    mode: _Mode = "verify",
    viewpoint: ArrayLike | None = None,
    *,
    steps: int = 10,
    points: int | None = None,
    dense: _Dense = "auto",
    best: int = 1,
) -> Registration: ...
def register_depth(
    depth: ArrayLike,
    camera: ArrayLike,
    target: _Cloud,
    init: _Starts = None,
    mode: _Mode = "verify",
    *,
    mask: ArrayLike | None = None,
    depth_scale: float = 1.0,
    steps: int = 10,
    points: int | None = None,
    dense: _Dense = "auto",
    best: int = 1,
) -> Registration: ...
def refine(
    source: _Cloud,
    target: _Cloud,
    init: _Starts = None,
    viewpoint: ArrayLike | None = None,
    *,
    points: int | None = None,
    dense: _Dense = "auto",
    best: int = 1,
) -> Registration: ...
def verify(
    source: _Cloud,
    target: _Cloud,
    init: _Starts = None,
    viewpoint: ArrayLike | None = None,
    *,
    points: int | None = None,
    dense: _Dense = "auto",
    best: int = 1,
) -> Registration: ...
def register_batch(
    sources: Iterable[_Cloud] | _Cloud,
    targets: Iterable[_Cloud] | _Cloud,
    init: _Start = None,
    mode: _Mode = "verify",
    viewpoint: ArrayLike | None = None,
    *,
    steps: int = 10,
    points: int | None = None,
    dense: _Dense = "auto",
    best: int = 1,
    return_exceptions: bool = False,
) -> list[Any]: ...
def points_of_depth(
    depth: ArrayLike, camera: ArrayLike, mask: ArrayLike | None = None, *, depth_scale: float = 1.0
) -> NDArray[float64]: ...
def evaluate(
    found: ArrayLike,
    truth: ArrayLike,
    sources: Iterable[ArrayLike] | NDArray[Any],
    targets: Iterable[ArrayLike] | NDArray[Any],
    *,
    raw: Iterable[ArrayLike] | NDArray[Any] | None = None,
) -> dict[str, Any]: ...
