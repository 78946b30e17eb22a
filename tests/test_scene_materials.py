"""Materials: what is refused and why, the lobes as the shader sees them, Yokoi's equations against plain numpy."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import numpy_shader
import pytest
from selection import few

from brdfcheck.brdf import catalog
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, Lambert
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.scene import materials
from brdfcheck.scene.artistic import Highlight, Metal, Translucent
from brdfcheck.scene.lights import Ambient, Distant, Environment, Point, Polygon, Spot
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.shading import shade
from brdfcheck.scene.white_furnace import furnace_largest

PUBLISHED = [entry.name for entry in catalog.entries() if not entry.validated]


def middle(name):
    ranges = catalog.entry(name).family.ranges
    return {key: {"n": 30.0, "m": 0.3, "alpha": 0.3, "reflectance": 1.0}[key] for key in ranges}


@pytest.fixture
def quick(monkeypatch):
    """What is refused is searched quickly: the search is not what is tested."""
    monkeypatch.setattr(materials, "check", functools.partial(materials.check, effort="quick"))


NORMALS, VIEWS = numpy_shader.normalised(np.random.default_rng(0).normal(size=(2, 400, 3)))
VIEWS = np.where(numpy_shader.dots(NORMALS, VIEWS)[:, None] < 0, -VIEWS, VIEWS)  # in front of the surface
POINTS = np.random.default_rng(5).normal(size=(400, 3)) * 0.3
DISTANT, FAR = Distant((0.4, 0.8, 0.5), (1.0, 0.8, 0.6)), {"direction": (0.4, 0.8, 0.5), "intensity": (1.0, 0.8, 0.6)}
POINT, NEAR = Point((-2, 1, 2), 0.5, linear_attenuation=0.3), {"position": (-2, 1, 2), "intensity": 0.5, "linear": 0.3}


def shaded(material, lights, dtype=np.float64):
    vectors = (jnp.asarray(part.T, dtype) for part in (POINTS, NORMALS, VIEWS))
    return np.asarray(shade(material, lights, *vectors)).T


# One of each lobe, of some lobes in both forms, and what is not clamped.
FAST = ("lambert", "phong", "blinn-phong", "schlick-mirror", "schlick-half", "kuijk-blake-half", "lyon-2-mirror")
FAST += ("binomial-power-half", "binomial-power-unclamped", "cook-torrance-published", "beckmann-smith-correlated", "ggx")


@pytest.mark.parametrize("name", few([entry.name for entry in catalog.entries() if entry.family.surface is None], FAST))
def test_every_brdf_of_the_catalogue_is_shaded_as_it_is_defined(name):
    brdf = catalog.entry(name).family.build(**middle(name))
    material = Surface(Term(name, **middle(name)), allow_unvalidated=True)
    light = numpy_shader.normalised(np.asarray(FAR["direction"]))
    # Into the local frame of each normal, by a reflection.
    lift = NORMALS - [0, 0, 1]
    lift = lift / np.linalg.norm(lift, axis=-1, keepdims=True)
    local = [v - 2 * numpy_shader.dots(lift, v)[:, None] * lift for v in (np.broadcast_to(light, VIEWS.shape), VIEWS)]
    wi, wo = (jnp.asarray(part) for part in local)
    expected = np.asarray(brdf(wi, wo) * jnp.maximum(wi[:, 2], 0))[:, None] * np.asarray(FAR["intensity"])
    found = shaded(material, (DISTANT,))
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-13)
    assert np.max(expected) > 0
    single = shaded(material, (DISTANT,), np.float32)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, rtol=2e-4, atol=2e-6)


def test_channels_of_lambert_and_fresnel_are_shaded():
    tint = jnp.array([0.9, 0.5, 0.2])

    def lit(*terms):
        return shaded(Surface(*terms, allow_unvalidated=True), (DISTANT,))

    coloured = lit(Term(CookTorrance(0.3, tint)))
    grey = [lit(Term(CookTorrance(0.3, f0)))[:, i] for i, f0 in enumerate(tint)]
    np.testing.assert_allclose(coloured, np.stack(grey, -1), rtol=1e-13)
    np.testing.assert_allclose(lit(Term(Lambert(tint))), lit(Term("lambert", tint)), rtol=1e-14)
    # A Fresnel term outside the lobe is the same as one inside.
    for name, inside in (("exact", "dielectric"), ("schlick", "schlick")):
        outside, within = Term(GGX(0.3), tint, fresnel=name), Term(GGX(0.3, tint, fresnel=inside))
        np.testing.assert_allclose(lit(outside), lit(within), rtol=1e-9)


def test_surface_against_plain_numpy_under_all_kinds_of_lights():
    spot = Spot((1, 2, 2), (-1, -2, -2), (0.2, 0.9, 0.4), spot_cutoff=30, spot_exponent=3, quadratic_attenuation=0.2)
    cone = {"position": (1, 2, 2), "spot_direction": (-1, -2, -2), "intensity": (0.2, 0.9, 0.4)}
    cone |= {"cutoff": 30, "exponent": 3, "quadratic": 0.2}
    factor = 32 * 34 / (8 * np.pi * (2**-15 + 30))
    expected = numpy_shader.surface(NORMALS, POINTS, VIEWS, [FAR, NEAR, cone], (0.5, 0.4, 0.1), (0.3, 0.3, 0.4), 30, factor)
    matt, glossy = Term("lambert", (0.5, 0.4, 0.1)), Term("blinn-phong", (0.3, 0.3, 0.4), n=30)
    found = shaded(Surface(matt, glossy), (DISTANT, POINT, spot))
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-14)
    # Ambient light meets the matt part only, a polygon the irradiance that it has, an environment all.
    np.testing.assert_allclose(shaded(Surface(matt, glossy), (Ambient(2.0),)), np.tile([1.0, 0.8, 0.2], (400, 1)))
    np.testing.assert_allclose(shaded(Surface(matt), (Environment(2.0),)), np.tile([1.0, 0.8, 0.2], (400, 1)))
    wall = [[3, -1, -1], [3, 1, -1], [3, 1, 1], [3, -1, 1]]
    lit = shaded(Surface(matt), (Polygon(wall, 2.0),))
    for i in range(0, 400, 80):
        brute = numpy_shader.polygon_irradiance(wall, POINTS[i], NORMALS[i])
        np.testing.assert_allclose(lit[i], 2 * brute / np.pi * np.array([0.5, 0.4, 0.1]), atol=1e-5)
    with pytest.raises(ValueError, match="Polygon light has a closed form on matt terms only; this surface has BlinnPhong"):
        shaded(Surface(matt, glossy), (Polygon(wall),))


@pytest.mark.parametrize("name", few(PUBLISHED, ("blinn-phong-6", "blinn-phong-8", "phong-classical")))
def test_what_is_not_conserving_is_refused_with_the_reason(name):
    # What some claim is true: those pass.
    if name in ("blinn-phong-6", "blinn-phong-linear", "phong-pdf"):
        Surface(Term(name, 0.5, n=50))
        return
    with pytest.raises(ValueError, match=f"{name} is not validated .*(VIOLATES: albedo|not reciprocal).*allow_unvalidated"):
        Surface(Term(name, **middle(name)))
    Surface(Term(name, **middle(name)), allow_unvalidated=True)


def test_a_family_is_checked_once(monkeypatch):
    calls = []
    real = materials.check
    monkeypatch.setattr(materials, "check", lambda *a, **k: calls.append(a) or real(*a, **k))
    materials._report.cache_clear()
    for n in (10.0, 20.0, 30.0):
        Surface(Term("lambert", 0.2), Term("blinn-phong", 0.7, n=n))
    assert [target for (target,) in calls] == ["lambert", "blinn-phong"]
    # Outside the range over which the family is checked, and for a lobe that is given, the BRDF itself is.
    Surface(Term("lyon-1-half", n=0.5))
    with pytest.raises(ValueError, match=r"kuijk-blake-mirror is not validated .VIOLATES: albedo 2.67569"):
        Surface(Term("kuijk-blake-mirror", n=3000.0))
    with pytest.raises(ValueError, match=r"BinomialPower is not validated .VIOLATES: albedo 1.5"):
        Surface(Term(BinomialPower(10.0)))
    assert len(calls) == 5


@pytest.mark.usefixtures("quick")
def test_a_sum_is_refused_by_how_much_it_reflects_too_much():
    Surface(Term("lambert", 0.7), Term("phong", 0.3, n=20))
    with pytest.raises(ValueError, match=r"up to 1.1 of the light in channel G, at 0 degrees: 0.1 more than arrives"):
        Surface(Term("lambert", (0.1, 0.5, 0.2)), Term("blinn-phong", 0.6, n=30))


@pytest.mark.slow
def test_a_sum_of_what_loses_energy_may_be_brighter():
    # More than 1 by the tints, less than 1 in fact: the lobe loses energy of its own.
    lossy = Term("binomial-power-half", 1.0, n=1.0)
    Surface(Term("lambert", 0.09), lossy)
    with pytest.raises(ValueError, match=r"the surface reflects up to 1.00638 of the light in channel R"):
        Surface(Term("lambert", 0.1), lossy)
    # A Fresnel reflectance reaches 1 at grazing incidence, where the light of the matt part is still there.
    with pytest.raises(ValueError, match=r"up to 1.07[0-9]* of the light in channel R, at 90 degrees: 0.07"):
        Surface(Term("lambert", 0.5), Term("ggx", 0.04, fresnel="schlick", alpha=0.05))


def glossy(wi, wo, n):
    """The Phong BRDF as a user writes it."""
    mirrored = -wi[..., 0] * wo[..., 0] - wi[..., 1] * wo[..., 1] + wi[..., 2] * wo[..., 2]
    above = (wi[..., 2] >= 0) & (wo[..., 2] >= 0)
    return (n + 2) / (2 * np.pi) * jnp.where(above, jnp.maximum(mirrored, 1e-30) ** n, 0)


def by_numpy(wi, wo):
    """The same at n = 20, which JAX cannot trace."""
    wi, wo = np.asarray(wi), np.asarray(wo)
    return 22 / (2 * np.pi) * np.maximum(np.sum(wi * [-1, -1, 1] * wo, axis=-1), 0) ** 20 * (wi[..., 2] >= 0)


def brushed(wi, wo):
    """More along x than along y, reciprocal."""
    return (1 + (wi[..., :1] * wo[..., :1]) ** 2) * np.array([0.4, 0.2, 0.1]) / np.pi


@pytest.mark.slow
@jax.numpy_dtype_promotion("standard")  # as users have it: numbers of a function may be of another precision
def test_functions_of_users_are_terms_like_lobes():
    lobe = Term("phong", (0.5, 0.3, 0.1), n=20)
    terms = [Term(glossy, (0.5, 0.3, 0.1), n=20), Term(by_numpy, (0.5, 0.3, 0.1))]
    terms.append(Term(lambda wi, wo: lobe.brdf(wi, wo), (0.5, 0.3, 0.1)))
    lights = (DISTANT, POINT, Ambient(0.3))
    for term in terms:
        for other, same in ((term, lobe), (Term(term.brdf, 0.4, fresnel="schlick"), Term(lobe.brdf, 0.4, fresnel="schlick"))):
            np.testing.assert_allclose(shaded(Surface(other), lights), shaded(Surface(same), lights), atol=1e-12)
        single = shaded(Surface(term), lights, np.float32)
        assert single.dtype == np.float32
        np.testing.assert_allclose(single, shaded(Surface(lobe), lights), atol=2e-5)
    few = [jnp.asarray(part[:6].T) for part in (POINTS, NORMALS, VIEWS)]
    surrounded = [np.asarray(shade(Surface(term), (Environment(0.7),), *few)) for term in (lobe, *terms)]
    for found in surrounded[1:]:
        np.testing.assert_allclose(found, surrounded[0], atol=1e-6)


def test_functions_have_derivatives_where_jax_traces_them():
    def brightness(n):
        lobe = Surface(Term(lambda wi, wo: glossy(wi, wo, n)), allow_unvalidated=True)
        return jnp.sum(shade(lobe, (DISTANT,), *(jnp.asarray(part.T) for part in (POINTS, NORMALS, VIEWS))))

    slope = jax.jit(jax.grad(brightness))(20.0)
    assert float(slope) == pytest.approx(float(brightness(20 + 1e-5) - brightness(20 - 1e-5)) / 2e-5, rel=1e-6)


@pytest.mark.slow
def test_channels_and_directions_of_functions_are_those_of_the_surface():
    # At the normal +z the axes are those of space; elsewhere x is level.
    up, sideways, surface = jnp.array([0.0, 0, 1]), jnp.array([1.0, 0, 0]), Surface(Term(brushed))
    for normal, x in ((up, sideways), (sideways, jnp.array([0.0, 0, -1])), (jnp.array([0.0, 1, 0]), sideways)):
        light = 0.6 * x + 0.8 * normal
        found = shade(surface, (Distant(light),), 0 * normal, normal, light)
        np.testing.assert_allclose(found, (1 + 0.6**4) * np.array([0.4, 0.2, 0.1]) / np.pi * 0.8, rtol=1e-12)
        # What comes back of a surrounding is the integral, from whichever side it is seen.
        y = jnp.cross(normal, x)
        along, across = (shade(surface, (Environment(1.0),), 0 * normal, normal, 0.6 * side + 0.8 * normal) for side in (x, y))
        np.testing.assert_allclose(across, [0.4, 0.2, 0.1], rtol=1e-6)
        np.testing.assert_allclose(along, (1 + 0.36 / 4) * np.array([0.4, 0.2, 0.1]), rtol=1e-6)


@pytest.mark.usefixtures("quick")
def test_functions_are_refused_like_lobes():
    with pytest.raises(materials.NotConserving, match=r"<lambda> is not validated .VIOLATES: albedo 3.14159"):
        Surface(Term(lambda wi, wo: 1.0))
    with pytest.raises(materials.NotConserving, match=r"up to 1.2[0-9]* of the light in channel R, at 0 degrees"):
        Surface(Term(glossy, 0.7, n=20), Term("lambert", 0.5))
    Surface(Term(glossy, 0.5, n=20), Term("lambert", 0.5))


@pytest.mark.slow
def test_functions_of_numpy_are_refused_like_lobes():
    with pytest.raises(materials.NotConserving, match=r"up to 1.2[0-9]* of the light in channel R, at 0 degrees"):
        Surface(Term(by_numpy, 0.7), Term("lambert", 0.5))


def test_materials_are_built_inside_traced_programs():
    def brightness(n, kd):
        material = Surface(Term("lambert", kd), Term("blinn-phong", 0.2, n=n))
        return jnp.sum(shade(material, (DISTANT,), *(jnp.asarray(part.T) for part in (POINTS, NORMALS, VIEWS))))

    slopes = jax.jit(jax.grad(brightness, (0, 1)))(20.0, 0.3)
    for i in range(2):
        shift = np.eye(2)[i] * 1e-5
        central = (brightness(20 + shift[0], 0.3 + shift[1]) - brightness(20 - shift[0], 0.3 - shift[1])) / 2e-5
        assert float(slopes[i]) == pytest.approx(float(central), rel=1e-6)


def test_highlight_and_translucent_are_the_printed_equations():
    options = {"d": 0.4, "w": 0.7, "n": 12.0}
    for lights, described in (((DISTANT,), [FAR]), ((DISTANT, POINT), [FAR, NEAR])):
        found = shaded(Highlight((0.8, 0.3, 0.1), **options), lights)
        expected = numpy_shader.highlight(NORMALS, POINTS, VIEWS, described, (0.8, 0.3, 0.1), **options)
        np.testing.assert_allclose(found, expected, atol=1e-13)
        behind = np.random.default_rng(2).random((400, 3))
        for t_p in (0.0, 0.5, 1.7):
            clear = Translucent((0.1, 0.3, 0.9), t_h=0.8, t_p=t_p, **options)
            expected = numpy_shader.highlight(
                NORMALS, POINTS, VIEWS, described, (0.1, 0.3, 0.9), behind=behind, t_h=0.8, t_p=t_p, **options
            )
            np.testing.assert_allclose(shaded(clear.over(behind.T), lights), expected, atol=1e-13)


@pytest.mark.parametrize("form", ["facets", "half", "mirror"])
def test_metal_is_the_printed_equation(form):
    if form == "facets":
        lobes = [[(0.013, 0.2), (0.1, 0.4)], [(0.1, 0.4)]]
    else:
        lobes = [[(0.2, 20.0), (0.8, 3.0)], [(0.4, 2.0)]]
    found = shaded(Metal((0.9, 0.7, 0.3), lobes, d=0.05, form=form), (DISTANT, POINT))
    with np.errstate(over="ignore"):
        expected = numpy_shader.metal(NORMALS, POINTS, VIEWS, [FAR, NEAR], (0.9, 0.7, 0.3), 0.05, lobes, form)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-13)


@pytest.mark.slow
def test_the_sharpest_of_what_is_accepted_is_finite_in_single_precision():
    # Rounding puts some of the cosines of 4000 normals around the mirror direction above 1.
    tilts = np.random.default_rng(3).normal(size=(4000, 2)) * 1e-4
    normals = numpy_shader.normalised(np.concatenate([tilts, np.ones((4000, 1))], 1)).astype(np.float32).T
    normals[:, 0] = 0, 0, 1
    light = numpy_shader.normalised(np.array([0.3, -0.2, 1]))
    view = np.broadcast_to((light * [-1, -1, 1]).astype(np.float32)[:, None], normals.shape)
    slopes = {"m", "alpha"}
    opaque = [entry for entry in catalog.entries() if entry.family.surface is None]
    facets = [entry.name for entry in opaque if slopes & entry.family.ranges.keys()]
    terms = [Term(name, **dict.fromkeys(catalog.entry(name).family.ranges, 1e-9)) for name in facets]
    surfaces = [Surface(term, allow_unvalidated=True) for term in terms]
    models = [
        Metal(1.0, [(0.1, 1e-9)]),
        *(Metal(1.0, [(0.1, n)], form=form) for n in (1e9, 3e38) for form in ("half", "mirror")),
    ]
    assert len(facets) > 5
    for material in (*surfaces, *models, Highlight(0.5, n=3e38)):
        image = np.asarray(shade(material, (Distant(light),), 0 * normals, normals, view))
        assert np.all(np.isfinite(image))
        assert image[0, 0] > 0
        if material in models[1:]:
            assert image.max() <= np.float32(0.15)  # d and w: the centre of a highlight, wherever rounding puts it


def test_a_class_of_the_package_is_known_by_its_name():
    assert Term("BlinnPhong", n=3).brdf == Term(BlinnPhong(3.0)).brdf


def test_whole_numbers_of_a_lobe_are_taken_as_check_takes_them():
    term = Term("lyon-1-half", n=5, w=3)
    assert (term.brdf.core.w, float(term.brdf.core.n)) == (3, 5)
    with pytest.raises(ValueError, match="lyon-1-half has no parameter 'k'"):
        Term("lyon-1-half", n=5, k=8)
    with pytest.raises(ValueError, match="phong: the parameter n must be given as a number"):
        furnace_largest("phong", {})


@pytest.mark.parametrize(
    ("build", "error", "words"),
    [
        (lambda: Term("blin-phong", n=3), KeyError, "did you mean"),
        (lambda: Term("blinn-phong"), ValueError, "blinn-phong needs its parameter n"),
        (lambda: Term("blinn-phong", n=3, m=2), ValueError, "has no parameter 'm'"),
        (lambda: Term("blinn-phong", n=-3), ValueError, "n must be finite and >= 0; got -3"),
        (lambda: Term("lambert", -0.5), ValueError, "tint must be finite and >= 0; got -0.5"),
        (
            lambda: Term(BlinnPhong(3.0), 1.5, fresnel="exact"),
            ValueError,
            "the Fresnel reflectance must be finite and >= 0 and <= 1",
        ),
        (lambda: Term("lambert", fresnel="cubic"), ValueError, "fresnel must be one of none, exact, schlick"),
        (lambda: Term(3), TypeError, "must be callable, f.wi, wo., or a catalogue name; got int"),
        (lambda: Term(glossy), ValueError, "glossy: the parameter n must be given as a number"),
        (lambda: Term(glossy, n=2, m=3), ValueError, "glossy has no parameter 'm'; its parameters: n"),
        (lambda: Term(glossy, n=np.inf), ValueError, "n must be finite; got inf"),
        (lambda: Term("none.py:glossy"), ValueError, "there is no file 'none.py'"),
        (lambda: Term(lambda wi, wo: wi[..., :2]), ValueError, "<lambda> has 2 channels; a scene takes 1, or 3: R, G and B"),
        (lambda: Term(lambda wi, wo: 1 / 0), ValueError, "raised ZeroDivisionError: division by zero"),
        (lambda: Term(BlinnPhong(3.0), n=3), TypeError, "a lobe has its parameters; got n beside BlinnPhong"),
        (lambda: Surface(), TypeError, "at least one Term"),
        (lambda: Highlight(1.5), ValueError, "base must be finite and >= 0 and <= 1"),
        (lambda: Highlight(0.5, w=2), ValueError, "w must be finite"),
        (lambda: Highlight(0.5, n=(1, 2)), ValueError, "n must be one number"),
        (lambda: Translucent(0.5, t_p=-1), ValueError, "t_p must be finite and >= 0"),
        (lambda: Translucent(0.5, behind=(1, 2)), ValueError, "behind must be a number or three"),
        (lambda: Metal(0.5, [(0.1, 0.0)]), ValueError, "the slope m must be finite and >= 1e-09; got .0.0.$"),
        (lambda: Metal(0.5, [(0.1, 1e39)], form="half"), ValueError, "lobes must be finite in single precision"),
        (lambda: Highlight(0.5, n=1e39), ValueError, "n must be finite in single precision"),
        (lambda: Term("cook-torrance", m=1e-20), ValueError, "cook-torrance: m must be finite and >= 1e-09"),
        (lambda: Term(GGX(1e-12)), ValueError, "GGX: alpha must be finite and >= 1e-09"),
        (lambda: Term(BlinnPhong(1e39)), ValueError, "a parameter of BlinnPhong must be finite in single precision"),
        (lambda: Metal(0.5, [(0.1, 0.2, 0.3)]), ValueError, "pairs of weight and slope"),
        (lambda: Metal(0.5, [(0.1, 0.2)], form="gold"), ValueError, "form must be one of"),
        (lambda: shaded(Metal(0.5, [[(0.1, 0.2)]] * 3), (DISTANT, POINT)), ValueError, "got 3 for 2 lights"),
        (lambda: shaded(Highlight(0.5), (Ambient(),)), ValueError, "Distant, Point and Spot lights only; got Ambient"),
        (lambda: shaded("red", (DISTANT,)), TypeError, "got str"),
        (lambda: shaded(Highlight(0.5), ((0, 0, 1),)), TypeError, "got tuple"),
    ],
)
def test_bad_materials_are_refused_in_one_line(build, error, words):
    with pytest.raises(error, match=words) as caught:
        build()
    assert "\n" not in str(caught.value)
