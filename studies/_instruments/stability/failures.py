"""Methods that fail where the production rule holds; the tests show each."""

KNOWN_FAILURES = (
    (
        "fixed 32 x 64 product rule at 45 degrees loses 2 % (n = 1000), 97 % (10^4), 100 % (10^5)",
        "the lobe falls between the nodes, and nothing in the sum says so",
        "integrate in the lobe's own angle; exact azimuth",
    ),
    (
        "float32 c^n is 0 beyond 65.3 degrees (n = 100), 23.6 (1000), 7.6 (10^4)",
        "XLA on CPU flushes subnormal numbers",
        "harmless in a sum; compare logarithms where ratios matter",
    ),
    (
        "pow(c, n) in float32 loses n 2^-25",
        "the rounding of c, not of the power",
        "exp(n log1p(-versine)) with the versine from half angles",
    ),
    (
        "float32 1 + (n/k)(c - 1) is off by 21 % at n = 10^7",
        "1 - c has no digits left where c was formed first",
        "the chord form of Lyon, or the versine",
    ),
    (
        "Schlick's lobe needs 20, 60, 184 Gauss nodes for n = 10, 100, 1000",
        "a pole at c = n/(n-1), next to the interval",
        "nodes graded like sinh towards the pole",
    ),
    (
        "64-point Gauss in u = c^(n+1) finds 1.0000059 for an exactly normalised Phong lobe",
        "the warp has a singularity at u = 0",
        "an error bar from a second rule; exact azimuth",
    ),
    (
        "float32 acos(cos 1e-4) = 0, acos(1 + 1.2e-7) = NaN, gradient -inf at 1",
        "acos is ill-conditioned at 1",
        "atan2, or 2 asin(sqrt(versine/2))",
    ),
    (
        "an even power without max(0, .) rises again past its first zero; an odd one is NaN at 15.5",
        "the base turns negative",
        "clamp before the power",
    ),
    (
        "generic adaptive code misses the Beckmann needle (m = cos theta = 1/64): off by over 0.9 of .9137, and claims 1e-8",
        "no sample ever lands on the needle",
        "seed panels at the mirror direction; the half-vector rule",
    ),
    (
        "Monte Carlo: relative deviation of one cosine sample 1.5 (n = 10), 16 (n = 1000)",
        "few samples meet the lobe",
        "importance sampling, or no chance at all",
    ),
    (
        "the 32 x 64 product rule: dE/dtheta of Phong and GGX breaks in 30 of 152 cells, in 13 of which the value does not",
        "the samples do not move with the lobe and the horizon: the derivative of the error is not small",
        "the zonal and half-vector rules: nodes follow lobe, kinks and horizon",
    ),
    (
        "dE/dtheta of GGX at 90 degrees has no limit: it grows like log(cos theta)",
        "the tail of the distribution falls like tan^-4: facets down to cos(theta) count",
        "the derivative at the cosine 6.4e-6 is given there and below, in either precision",
    ),
    (
        "float32: dE/dtheta at 90 degrees is that at the cosine 6.4e-6, 0.9 % from the limit at m = 0.001",
        "kinks are lost in rounding closer to 90 degrees",
        "float64, where the cosine is 1.8e-12",
    ),
    (
        "the unclamped binomial power overflows float32 (k = 16, n = 10^5): value and error bar are inf",
        "the rebound reaches (n/k)^k",
        "clamp; or float64",
    ),
    (
        "float32: dE/dtheta of the unclamped power (mirror form, k = 16) is off by up to 2 %",
        "the rebound multiplies the rounding of cosines near 90 degrees by k, and the derivative is a difference",
        "clamp; or float64",
    ),
    (
        "float32: facets with a slope below 1e-18 have the value NaN and the error bar inf",
        "the peak of the distribution, 1/(pi m^2), is above the largest float32",
        "float64, or a mirror",
    ),
    (
        "float32: a factor within 1e-6 of the exact one is UNDECIDED",
        "error bars are 4e-6 or more",
        "brdfcheck.use_x64()",
    ),
)
"""What fails where the production rule holds: (what, cause, remedy); shown by the tests."""
