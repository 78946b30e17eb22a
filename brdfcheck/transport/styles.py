"""How each solver is drawn, for life: colour and marker (those of Okabe & Ito 2008, without the yellow)."""

from __future__ import annotations

SOLVERS: dict[str, tuple[str, str]] = {
    "direct": ("#000000", "X"),
    "krylov": ("#0072B2", "o"),
    "progressive": ("#E69F00", "s"),
    "neumann": ("#009E73", "^"),
    "paths": ("#CC79A7", "D"),
}
LABELS: dict[str, str] = {
    "direct": "direct (LU)",
    "krylov": "conjugate gradients",
    "progressive": "progressive shooting",
    "neumann": "Neumann series",
    "paths": "path tracing",
}
