"""How much is enough: the cheapest combination of models whose picture of a scene is within a tolerance of the full one.

    found = brdfcheck.budget("scene.toml", tolerance="0.5/255")
    found.chosen, found.error, found.seconds, found.full_seconds

`scenes` reads the scene, `knobs` says what may be simplified in it, `programs` renders and times (in a `room`, too),
`measure` finds what each rung errs and costs, `search` the cheapest combination.
"""
