"""Words of the command line and files of users."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import shaders

from brdfcheck.brdf import catalog
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.readers.python import load_module, load_object, split_spec
from brdfcheck.brdf.subject import Target, as_target, family_target, load, named, resolve
from brdfcheck.fits.raw import of_exponent
from brdfcheck.messages import UsageError, one_line

Write = Callable[..., str]


@pytest.fixture
def write(here: Path) -> Write:
    """Writes a Python file and returns its path."""
    return lambda source, name="mine.py": shaders.write(here, textwrap.dedent(source), name)


def one(spec: str, **ranges: tuple[float, float]) -> Target:
    return resolve([spec], ranges, None)[0]


def test_small_things() -> None:
    assert one_line("a\n  b\x1b[31m\tc") == "a b[31m c"
    assert split_spec("a:b/mine.py:f") == ("a:b/mine.py", "f")
    assert split_spec("mine.py") == ("mine.py", None)


# --- files ---


def test_neighbours_can_be_imported_and_prints_are_harmless(write: Write) -> None:
    write("scale = 0.25", "neighbour_of_mine.py")
    path = write(
        """
        from neighbour_of_mine import scale
        print(__file__)
        def brdf(wi, wo):
            return scale + 0 * wi[..., 2]
        """
    )
    value, spec = load_object(path)
    assert spec == f"{path}:brdf"
    assert value(np.ones((1, 3)), None) == 0.25
    assert sys.modules[value.__module__].__file__ == path


def test_neighbours_of_two_folders_are_not_confused(write: Write) -> None:
    for folder in "ab":
        write(f"name = '{folder}'", f"{folder}/twin_helper.py")
        path = write("from twin_helper import name\ndef brdf(): return name", f"{folder}/mine.py")
        assert load_object(path)[0]() == folder


def test_a_file_is_read_afresh(write: Write) -> None:
    for value in "12":
        assert load_module(write(f"value = {value}")).value == int(value)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("x = 1\nx = undefined", "line 2: NameError: name 'undefined' is not defined"),
        ("def f(:", "line 1: SyntaxError"),
        ("import sys\nsys.exit('done')", r"line 2: it calls sys\.exit\('done'\) while being imported"),
        ("import no_such_module_anywhere", "line 1: ModuleNotFoundError"),
        ("raise ValueError('two\\nlines')", "ValueError: two lines"),
    ],
)
def test_a_file_that_cannot_be_imported_says_why(write: Write, source: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        load_module(write(source))
    assert "\n" not in str(caught.value)


def test_missing_files_and_objects(write: Write, tmp_path: Path) -> None:
    path = write("def first(wi, wo): ...\ndef second(wi, wo): ...\nvalue = 3\n_hidden = first")
    for spec, message in (
        (f"{tmp_path}/absent.py:f", "there is no file"),
        (f"{tmp_path}:f", "path/to/file.py:object"),
        (f"{tmp_path}/mine.txt:f", "path/to/file.py:object"),
        (f"{path}:third", "has no object 'third'; it offers first, second"),
        (f"{path}:value", r"is not callable \(int\)"),
        (path, "say which object .* first, second"),
        (write("x = 1", "empty.py"), "it defines no public callable"),
    ):
        with pytest.raises(UsageError, match=message):
            load_object(spec)
    folder = tmp_path / "folder.py"
    folder.mkdir()
    with pytest.raises(UsageError, match="is a folder"):
        load_object(f"{folder}:f")
    assert load_object(f"{path}:first.__call__")[1].endswith("first.__call__")


# --- kinds of objects ---

KINDS = """
    import jax.numpy as jnp
    from brdfcheck import BinomialPower, Factor, Normalized, Phong

    instance = Phong(3.0)

    def function(wi, wo):
        return 0 * wi[..., 2]

    def function_with_parameter(wi, wo, strength):
        return strength + 0 * wi[..., 2]

    def unusual_names(a, b):
        return 0 * a[..., 2]

    def factory(n, ks=0.5):
        return Normalized(Phong(n), Factor(2.0, 2 * jnp.pi / ks))

    def pair(roughness, tint):
        return function

    def odd_pair(first, second):
        return function

    def of_three(a, b, c):
        return function

    def components(lx, ly, lz, vx, vy, vz):
        return 0.3

    def no_parameters():
        return function

    def open_ended(**parameters):
        return Phong(parameters["n"])

    class Mine:
        def __init__(self, gloss):
            self.gloss = gloss
        def __call__(self, wi, wo):
            return self.gloss + 0 * wi[..., 2]

    def sized(n, k: int = 16):
        return BinomialPower(n, k)

    def hard_coded(n):
        return BinomialPower(n, 15)
"""


@pytest.fixture
def kinds(write: Write) -> str:
    return write(KINDS)


WI = np.array([[0.6, 0.0, 0.8]])


@pytest.mark.parametrize(
    ("name", "ranges", "value"),
    [
        ("function", {}, 0.0),
        ("unusual_names", {}, 0.0),
        ("function_with_parameter", {"strength": (0.0, 1.0)}, 1.0),
        ("Mine", {"gloss": (0.0, 1.0)}, 1.0),
        ("no_parameters", {}, 0.0),
        ("pair", {"roughness": (0.0, 1.0), "tint": (0.0, 1.0)}, 0.0),
    ],
)
def test_every_kind_of_object_becomes_a_family(kinds: str, name: str, ranges: dict, value: float) -> None:
    target = one(f"{kinds}:{name}", **ranges)
    assert target.finding is None
    assert target.family.name == f"{kinds}:{name}"
    assert target.family.ranges == ranges
    assert target.file == kinds
    assert target.line
    brdf = target.family.build(**{parameter: high for parameter, (_, high) in ranges.items()})
    assert np.asarray(brdf(WI, WI)) == pytest.approx(value)


def test_instances_factories_and_open_ends(kinds: str) -> None:
    assert one(f"{kinds}:instance").family.build().n == 3
    assert one(f"{kinds}:factory", n=(1.0, 2.0)).family.build(n=jnp.asarray(2.0)).lobe.n == 2
    assert set(one(f"{kinds}:factory", n=(1.0, 2.0), ks=(0.1, 1.0)).family.ranges) == {"n", "ks"}
    assert one(f"{kinds}:open_ended", n=(1.0, 2.0)).family.build(n=1.5).n == 1.5


def test_whole_numbers_are_passed_as_such(kinds: str) -> None:
    target = one(f"{kinds}:sized", n=(1.0, 2.0), k=(4.0, 4.0))
    assert target.family.held == {"k": 4}
    assert target.family.build(n=1.0).k == 4
    assert set(target.family.ranges) == {"n"}


@pytest.mark.parametrize(
    ("name", "ranges", "message"),
    [
        ("of_three", {"b": (0.2, 0.2)}, "the parameters a, c must be given a range: --over a=LO:HI --over c=LO:HI"),
        ("factory", {}, "the parameter n must be given a range: --over n=LO:HI"),
        ("Mine", {}, "the parameter gloss must be given"),
        ("components", {}, "be given a range: .*; or write f\\(wi, wo, ...\\) where these are directions"),
        ("pair", {}, "the parameters roughness, tint must be given"),
        ("odd_pair", {}, "the parameters first, second must be given"),
        ("function_with_parameter", {}, "the parameter strength must be given"),
        ("factory", {"n": (1.0, 2.0), "gloss": (0.0, 1.0)}, "no parameter 'gloss'; its parameters: n, ks"),
        ("function", {"n": (1.0, 2.0)}, "no parameter 'n'; its parameters: none"),
        ("instance", {"m": (1.0, 2.0)}, "has no parameter 'm'; its parameters: n"),
        ("sized", {"n": (1.0, 2.0), "k": (2.0, 4.0)}, "k is a whole number"),
        ("sized", {"n": (1.0, 2.0), "k": (3.0, 3.0)}, "k must be a positive even integer; got 3"),
        ("hard_coded", {"n": (1.0, 2.0)}, "k must be a positive even integer; got 15"),
        ("factory", {"n": (-1.0, 2.0)}, "n must be finite and >= 0; got -1"),
    ],
)
def test_parameters_are_checked_before_the_work(kinds: str, name: str, ranges: dict, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        one(f"{kinds}:{name}", **ranges)


def test_a_batch_of_lobes_is_refused_in_one_line(write: Write) -> None:
    """It ended as an internal error, and nothing else of the command was checked."""
    path = write(
        """
        import jax.numpy as jnp
        from brdfcheck import Phong
        batched = Phong(jnp.array([1.0, 2.0]))
        def dark(wi, wo):
            return 0.1 + 0 * wi[..., 2]
        """
    )
    with pytest.raises(UsageError, match="this lobe holds a batch of parameters of shape"):
        as_target(f"{path}:batched")
    dark, batched = resolve([f"{path}:dark", f"{path}:batched"], {}, None, others_go_on=True)
    assert (dark.unread, batched.unread) == (False, True)


# --- the catalogue, and both together ---


def test_catalogue_names() -> None:
    target = family_target(catalog.entry("phong").family, {"n": (1.0, 2.0)}, (0.5, 1.0))
    assert (target.family.ranges, target.family.cos_theta) == ({"n": (1.0, 2.0)}, (0.5, 1.0))
    for name, ranges, message in (
        ("fong", {}, "unknown BRDF 'fong'; did you mean phong"),
        ("phong", {"n": (-1.0, 2.0)}, "phong at n=-1: n must be finite and >= 0"),
        ("ggx", {"alpha": (0.0, 1.0)}, "alpha must be finite and > 0"),
    ):
        for given in (name, *([load(name)] if name in catalog.names() else [])):
            with pytest.raises(UsageError, match=message):
                as_target(given, ranges)
    assert as_target(load("binomial-power-half"), {"k": (8.0, 8.0)}).family.held == {"k": 8}
    for given in ("phong", load("phong")):
        with pytest.raises(UsageError, match="phong has no parameter 'k'; its parameters: n"):
            as_target(given, {"k": (1.0, 2.0)})


@pytest.mark.parametrize("door", [as_target, lambda spec: named(spec, {}), lambda spec: of_exponent(spec, (1.0, 10.0))])
def test_where_one_brdf_is_asked_for_a_file_of_several_is_refused(write: Write, door: Callable[[str], object]) -> None:
    """A proof of the first was printed as one of the file."""
    path = write(
        """
        def dark(wi, wo):
            return 0.1 + 0 * wi[..., 2]
        def glowing(wi, wo):
            return 0.7 + 0 * wi[..., 2]
        """
    )
    both = rf"mine.py:\* stands for 2 BRDFs \({path}:dark, {path}:glowing\): give one of them"
    with pytest.raises(UsageError, match=both):
        door(f"{path}:*")
    alone = write("def matt(wi, wo):\n    return 0.1 + 0 * wi[..., 2]\n", "alone.py")
    door(f"{alone}:*")


def test_whole_numbers_of_a_lobe_are_those_that_it_is_built_from() -> None:
    """Lyon's k is 2^w."""
    family = as_target("lyon-1-half", {"w": (3.0, 3.0)}).family
    assert family.held == {"w": 3}
    assert (family.build(n=5.0).core.w, family.build(n=5.0).core.k) == (3, 8)
    with pytest.raises(UsageError, match="lyon-1-half has no parameter 'k'; its parameters: n, w"):
        resolve(["lyon-1-half"], {"k": (3.0, 3.0)}, None)


def test_a_range_must_belong_to_some_brdf(kinds: str) -> None:
    with pytest.raises(UsageError, match="phong has no parameter 'm'; its parameters: n"):
        resolve(["phong"], {"m": (0.1, 1.0)}, None)
    with pytest.raises(UsageError, match="none of the BRDFs has a parameter 'q'; their parameters: alpha, n"):
        resolve(["phong", "ggx"], {"q": (0.1, 1.0)}, None)
    phong, ggx = resolve(["phong", "ggx"], {"alpha": (0.1, 0.2)}, None)
    assert (phong.family.ranges["n"], ggx.family.ranges["alpha"]) == ((0.01, 1e5), (0.1, 0.2))
    phong, mine = resolve(["phong", f"{kinds}:Mine", "phong"], {"n": (1.0, 2.0), "gloss": (0.0, 1.0)}, None)
    assert (phong.family.ranges, mine.family.ranges) == ({"n": (1.0, 2.0)}, {"gloss": (0.0, 1.0)})


@pytest.mark.parametrize(
    ("name", "line"),
    [("plain", 5), ("made", 8), ("decorated", 11), ("Material.eval", 16), ("imported", 2), ("either", 22), ("both", 23)],
)
def test_the_line_is_where_the_file_gives_the_name(write: Write, name: str, line: int) -> None:
    write("def imported(wi, wo):\n    return 0.1 + 0 * wi[..., 2]\n", "neighbour_with_a_line.py")
    source = """
        from neighbour_with_a_line import imported
        import functools, jax

        def plain(wi, wo):
            return 0.1 + 0 * wi[..., 2]

        made = functools.partial(plain)

        @jax.jit
        def decorated(wi, wo):
            return 0.1 + 0 * wi[..., 2]

        class Material:
            eval = None
            def eval(wi, wo):
                return 0.1 + 0 * wi[..., 2]

        if False:
            either = None
        else:
            either = plain
        both, other = plain, 3
        """
    path = write(source)
    target = one(f"{path}:{name}")
    assert (target.file, target.line) == (path, line)


def test_families_of_a_file_are_taken(write: Write) -> None:
    path = write(
        """
        import brdfcheck

        def sloped(wi, wo, albedo):
            return albedo / 3.2 + 0 * wi[..., 2]

        named = brdfcheck.load("lyon-1-half", n=(1, 50))
        own = brdfcheck.load(sloped, albedo=(0.1, 0.9))
        """
    )
    assert one(f"{path}:named").family.ranges == {"n": (1.0, 50.0)}
    own = as_target(f"{path}:own", {"albedo": (0.2, 0.3)})
    assert (own.family.name, own.family.ranges, own.file, own.line) == (f"{path}:own", {"albedo": (0.2, 0.3)}, path, 8)
    assert one(f"{path}:named", n=(2, 3)).family.ranges == {"n": (2, 3)}
    with pytest.raises(UsageError, match=r"mine\.py:own has no parameter 'm'; its parameters: albedo"):
        one(f"{path}:own", m=(1, 2))
    with pytest.raises(UsageError, match=r"--returns is for functions in files; got .*mine\.py:own"):
        resolve([f"{path}:own"], {}, None, Reading(returns="brdf*cos"))
    every = resolve([f"{path}:*"], {"albedo": (0.1, 0.9)}, None)
    assert [target.family.name.rpartition(":")[2] for target in every] == ["sloped", "named", "own"]
