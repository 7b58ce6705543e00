"""Materials as what paths of a wavefront meet: each an interactor of the same few functions.

advance(paths, stop)
    Takes paths on to their next event, or to distances stop (n,) m: what they have come to (n,), REACHED, EVENT, ENDED or
    ELSEWHERE, and what `next_event` and `scatter` need of it, arrays by path.  Paths at events are where the event is.
transmittance(states, origin, direction, distance, left_out, share)
    Multiplies share (n, L) by what the material leaves of light along ways of which it is the innermost material.
next_event(paths, event, sample, passed, clear, added)
    What light samples send by way of events: added (n, 3), linear sRGB; passed (n, L) is what is left of the light on its way.
scatter(paths, event)
    Turns paths; their densities become those of the directions.

`medium` is a continuous medium, also that in a body; `bodies` one inside of a shape, whose paths go on in compiled loops up to
its boundary; `particles` are discs; `grains` stick out of their region and hide light: they are looked for by themselves.
"""
