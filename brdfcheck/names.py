"""Packages whose names are imported when they are first used. Imports nothing, so that ``import brdfcheck`` costs nothing."""

from __future__ import annotations

TYPE_CHECKING = False  # type checkers take it for true; the one of `typing` would be a dear import
if TYPE_CHECKING:
    from collections.abc import Callable


def lazy(package: str, file: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` for the ``__init__.py`` (`file`) of a package; the stub beside it names what there is."""

    read: list[tuple[Callable[[str], object], Callable[[], list[str]], list[str]]] = []  # the stub, once it is

    def attached() -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
        if not read:
            import lazy_loader

            read.append(lazy_loader.attach_stub(package, file))
        return read[0]

    def attribute(name: str) -> object:
        if name.startswith("__") and name != "__all__":  # what the import system asks of any module
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        get, _, names = attached()
        if name == "__all__":
            return names
        if name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return get(name)

    return attribute, lambda: attached()[2]
