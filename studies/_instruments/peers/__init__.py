"""Other people's integrators, with the signature of our rules: what a user would pick instead.

They integrate f(wi, wo) cos(theta) sin(theta) over the polar angle and the azimuth as it stands: no change of variable of
ours, no reduction to one dimension. SciPy comes with this package; the others with ``pip install 'brdfcheck[peers]'``.

    for name, peer in PEERS.items():
        if peer.missing() is None:           # else the message that says what to install
            estimate = peer(peer.ladder[2])(brdf, cos_theta, key=key)
"""

from __future__ import annotations

from types import MappingProxyType

from _instruments.peers.mitsuba_peer import MitsubaSampling
from _instruments.peers.peer import AbstractPeer
from _instruments.peers.quadax_peer import QuadaxCubature, QuadaxNested
from _instruments.peers.scipy_peer import ScipyCubature, ScipyDblquad, ScipyQuad
from _instruments.peers.torchquad_peer import TorchquadGauss

PEERS: MappingProxyType[str, type[AbstractPeer]] = MappingProxyType(
    {
        peer.name: peer
        for peer in (ScipyQuad, ScipyDblquad, ScipyCubature, QuadaxNested, QuadaxCubature, TorchquadGauss, MitsubaSampling)
    }
)

__all__ = ["PEERS", "AbstractPeer"]
