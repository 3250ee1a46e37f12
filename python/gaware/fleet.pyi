from collections.abc import Callable, Iterable
from os import PathLike
from typing import Any

from . import Model, Table

ATTEMPTS: int

class Fleet:
    results: list[tuple[str, dict[str, Any] | None, str | None]]
    @property
    def flights(self) -> Table: ...
    @property
    def effects(self) -> Table: ...
    @property
    def failed(self) -> dict[str, str]: ...
    def write(self, out: str | PathLike[str]) -> list[str]: ...

def find(places: Iterable[str | PathLike[str]]) -> list[str]: ...
def analyse(
    log: str | PathLike[str],
    *,
    model: Model | None = None,
    explain: bool = True,
    out: str | PathLike[str] | None = None,
    storage_options: dict[str, Any] | None = None,
    source: str | None = None,
    vehicle: int | None = None,
) -> dict[str, Any]: ...
def run(
    logs: Iterable[str | PathLike[str]],
    *,
    client: Any | None = None,
    jobs: int | None = None,
    model: Model | None = None,
    explain: bool = True,
    names: str | None = None,
    out: str | PathLike[str] | None = None,
    storage_options: dict[str, Any] | None = None,
    source: str | None = None,
    vehicle: int | None = None,
    progress: Callable[[int, int, str], object] | None = None,
) -> Fleet: ...
def report(out: str | PathLike[str], names: str | None = None) -> dict[str, Any]: ...
