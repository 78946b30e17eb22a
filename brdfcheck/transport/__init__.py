"""What an albedo above 1 does to a scene: four solvers of L = Le + K L on the same closed enclosures.

    room = transport.box((1.0, 1.0, 0.5), (16, 16, 8))              # 1,024 patches, closed forms
    light = room.on_wall(4, 1.0)                                    # radiosity emitted by the floor
    transport.direct(room, light, reflectance=0.7)                  # value, error, residual, cost, message
    transport.krylov(room, light, 0.7); transport.progressive(room, light, 0.7); transport.neumann_series(room, light, 0.7)
    transport.trace(room, light, 0.7, key=jax.random.key(0))        # Monte Carlo paths, any lobe of the catalogue

`angular_operator` is the transport of one BRDF inside a sphere, where it depends on the angle of incidence alone; its
spectral radius is the largest that any enclosure with otherwise loss-free walls can have. Names are imported when used.
"""

from brdfcheck.names import lazy

__getattr__, __dir__ = lazy(__name__, __file__)
