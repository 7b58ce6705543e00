"""Walks of light in plane layers on each other: how far from where it went in it comes out.

Far from the faces of its layer light diffuses.  In a layer without end a walk that is deep goes at once to where it first meets a
plane nearer to the face, in a layer of a thickness to where it first meets a sphere about it; with the share of the light that is
not absorbed on the way.  So light that comes back late takes tens of steps, not millions.
"""

import math

from bakery.physics.medium.kernels import phase_sample, turned_direction
from bakery.system.compiled import njit

CLASSES = 3  # of directions, of equal flux: thirds of the square of the sine
_LOW, _KEPT = 0.1, 0.3  # weight below which Russian roulette is played, and the weight of the survivors
# transport mean free paths: from where light is taken to diffuse, how near to a face it comes so, and how far above a plane that
# lets all light out the density of diffuse light would be 0 (Milne)
_DIFFUSE, _PLANE, _MILNE = 6.0, 2.0, 0.7104
_FAINT = 1e-3  # importance below which Russian roulette is played
_ATTENUATED = 6.0  # attenuation lengths within which far returns are drawn evenly
_TRIES = 32  # of facets, until one sends light to where it can be seen


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _mirrored(mu, index):
    """Unpolarised share that a plane reflects, and the cosine behind it; index of what is behind over that of what is before."""
    square = (index - 1.0) * (index + 1.0) + mu * mu
    if square <= 0.0:
        return (1.0, 0.0) if index != 1.0 else (0.0, mu)
    behind = math.sqrt(square) / index
    across, along = (mu - index * behind) / (mu + index * behind), (index * mu - behind) / (index * mu + behind)
    return 0.5 * (across * across + along * along), behind


@njit(cache=True, nogil=True, error_model="numpy")
def _by_facets(stream, x, y, z, index, alpha):
    """Direction (z up, back to the side that it comes from) of light from direction (x, y, z), z above 0, after rough facets.

    Facets that are seen (Dupuy and Benyoub 2023) reflect or refract; what others hide is drawn anew.
    """
    for _ in range(_TRIES):
        length = math.sqrt(alpha * alpha * (x * x + y * y) + z * z)
        ax, ay, az = alpha * x / length, alpha * y / length, z / length
        turn, height = 2.0 * math.pi * stream.random(), (1.0 - stream.random()) * (1.0 + az) - az
        flat = math.sqrt(max(1.0 - height * height, 0.0))
        nx, ny, nz = alpha * (flat * math.cos(turn) + ax), alpha * (flat * math.sin(turn) + ay), max(height + az, 1e-12)
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / length, ny / length, nz / length
        onto = x * nx + y * ny + z * nz
        if onto <= 0.0:
            continue
        share, behind = _mirrored(onto, index)
        if stream.random() < share:
            ox, oy, oz = 2.0 * onto * nx - x, 2.0 * onto * ny - y, 2.0 * onto * nz - z
            if oz <= 0.0:
                continue
        else:
            scale = onto / index - behind
            ox, oy, oz = scale * nx - x / index, scale * ny - y / index, scale * nz - z / index
            if oz >= 0.0:
                continue
        seen = 2.0 / (1.0 + math.sqrt(1.0 + alpha * alpha * (1.0 - oz * oz) / (oz * oz)))
        if stream.random() < seen:
            return ox, oy, oz
    return -x, -y, z


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(stream, ux, uy, uz, index, alpha):
    """Direction u (z into what it meets, above 0) after a boundary: whether it passes, and x, y and the size of z."""
    if alpha > 0.0 and index != 1.0:
        ox, oy, oz = _by_facets(stream, -ux, -uy, uz, index, alpha)
        return oz < 0.0, ox, oy, abs(oz)
    share, behind = _mirrored(uz, index)
    if stream.random() < share:
        return False, ux, uy, uz
    return True, ux / index, uy / index, behind


@njit(cache=True, nogil=True, error_model="numpy")
def _roulette(stream, weight):
    """The weight with which a walk goes on; 0: it ends."""
    if weight >= _LOW:
        return weight
    return _KEPT if stream.random() * _KEPT < weight else 0.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _anywhere(stream):
    """A direction with even odds."""
    up, turn = 2.0 * stream.random() - 1.0, 2.0 * math.pi * stream.random()
    across = math.sqrt(1.0 - up * up)
    return across * math.cos(turn), across * math.sin(turn), up


@njit(cache=True, nogil=True, error_model="numpy")
def _leapt(stream, weight, position, direction, thickness, transport, decay, far):
    """Weight and position where diffuse light leaves a sphere, and a direction; and what is lost for good, deeper than `far`."""
    (px, py, pz), (ux, uy, uz) = position, direction
    # on average light goes on by a transport mean free path before it has forgotten its direction
    px, py, pz = px + transport * ux, py + transport * uy, pz + transport * uz
    radius = min(pz, thickness - pz) - _PLANE * transport
    if decay > 0.0:
        x = decay * radius
        weight *= x / math.sinh(x) if x < 300.0 else 0.0
    dx, dy, dz = _anywhere(stream)
    position, direction = (px + radius * dx, py + radius * dy, pz + radius * dz), _anywhere(stream)
    if position[2] > far:
        return 0.0, position, direction, weight
    return _roulette(stream, weight), position, direction, 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _return_to_plane(stream, weight, px, py, height, far, decay):
    """Weight, importance and position where diffuse light first meets a plane at a distance `height`, decay per length.

    Of light at rho (distance from the start) or further, height exp(-decay rho) / rho arrives.  Half of the draws follow that
    without the exponential, half lie evenly between height and `far`, where most of the mean squared distance comes from: the
    quotient of the densities is the importance.
    """
    reach = min(far, height + _ATTENUATED / decay) if decay > 0.0 else far
    if reach <= 2.0 * height:
        rho, share = height / (1.0 - stream.random()), 1.0
    else:
        even = stream.random() < 0.5
        rho = height + (reach - height) * stream.random() if even else height / (1.0 - stream.random())
        share = 0.5 + (0.5 * rho * rho / (height * (reach - height)) if rho < reach else 0.0)
    importance = (1.0 + decay * rho) * math.exp(-decay * (rho - height)) / share
    r, turn = math.sqrt((rho - height) * (rho + height)), 2.0 * math.pi * stream.random()
    return weight * math.exp(-decay * height), importance, px + r * math.cos(turn), py + r * math.sin(turn)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _leaves_diffuse(stream):
    """A direction upwards of diffuse light that leaves a plane: flux as cosine (1 + 2 cosine), within 3 % of Milne's problem."""
    up, turn = stream.random(), 2.0 * math.pi * stream.random()
    up = math.sqrt(up) if stream.random() < 3.0 / 7.0 else up ** (1.0 / 3.0)
    across = math.sqrt(1.0 - up * up)
    return across * math.cos(turn), across * math.sin(turn), -up


@njit(cache=True, nogil=True, error_model="numpy")
def _from_the_deep(stream, weight, importance, position, direction, transport, decay, far):
    """Weight, importance, position and direction of a walk back at the plane; and what is lost for good, deeper than `far`."""
    (px, py, pz), (ux, uy, uz) = position, direction
    # on average light goes on by a transport mean free path before it has forgotten its direction
    height = pz + (uz - _PLANE + _MILNE) * transport
    if height > far:
        return 0.0, importance, position, direction, weight
    weight, share, px, py = _return_to_plane(stream, weight, px + transport * ux, py + transport * uy, height, far, decay)
    weight, importance = _roulette(stream, weight), importance * share
    if importance < _FAINT:
        importance = _FAINT if stream.random() * _FAINT < importance else 0.0
    return weight, importance, (px, py, _PLANE * transport), _leaves_diffuse(stream), 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _tally(radius2, cosine, weight, edges, light, square, beyond):
    """Adds the weight of a walk that comes out, by the cosine in air and the squared distance.

    light, square, beyond : sums of its class of incidence
    """
    out, last, radius = min(int(CLASSES * (1.0 - cosine * cosine)), CLASSES - 1), len(edges) - 1, math.sqrt(radius2)
    if radius >= edges[last]:
        beyond[0] += weight
        return
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) >> 1
        if edges[middle] <= radius:
            low = middle
        else:
            high = middle
    light[out, low] += weight
    square[out] += weight * radius2


@njit(nogil=True, error_model="numpy", forceinline=True)
def _off_base(stream):
    """A direction upwards, as a matt base sends light on."""
    up, turn = math.sqrt(stream.random()), 2.0 * math.pi * stream.random()
    across = math.sqrt(1.0 - up * up)
    return across * math.cos(turn), across * math.sin(turn), -up


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _deep(stream, weight, importance, position, direction, thickness, transport, decay, far):
    """Weight, importance, position and direction of diffuse light once it is nearer to a face of its layer; and what is lost."""
    if thickness == math.inf:
        return _from_the_deep(stream, weight, importance, position, direction, transport, decay, far)
    weight, position, direction, lost = _leapt(stream, weight, position, direction, thickness, transport, decay, far)
    return weight, importance, position, direction, lost


@njit(cache=True, nogil=True, error_model="numpy")
def follow(stream, walks, layers, table, edges, light, square, beyond):
    """Walks of a block, `CLASSES` times `walks`, added to sums.

    stream : numpy.random.Generator
    walks : of each class of incidence
    layers : media (J, 5) from the top: sigma_t, albedo, thickness, transport mean free path, decay of diffuse light;
        faces (J + 1, 2): index of what is below over that of what is above, roughness; albedo of the base, below 0 for air
    table : of `phase_layout`, (J, A) of each layer at angles that all share;  edges : (B + 1,) distances, ascending from 0
    light : (C, C, B) weight by class of incidence and of exitance, and distance
    square : (C, C) weight times squared distance
    beyond : (C,) weight of walks that came out beyond the last edge, or went as deep in their layer
    """
    (media, faces, base), (v_nodes, steps, f, cdf) = layers, table
    last = len(media) - 1
    for n in range(CLASSES * walks):
        into, j = n % CLASSES, 0
        sine = math.sqrt((into + (n // CLASSES + stream.random()) / walks) / CLASSES)
        passes, ux, uy, uz = _cross(stream, sine, 0.0, math.sqrt(1.0 - sine * sine), faces[0, 0], faces[0, 1])
        if not passes:
            continue
        px, py, pz, weight, importance = 0.0, 0.0, 0.0, 1.0, 1.0  # pz: below the upper face of layer j
        while True:
            sigma_t, albedo, thickness, transport, decay = media[j]
            if min(pz, thickness - pz) > _DIFFUSE * transport:
                weight, importance, (px, py, pz), (ux, uy, uz), lost = _deep(
                    stream, weight, importance, (px, py, pz), (ux, uy, uz), thickness, transport, decay, edges[-1])
                beyond[into] += lost * importance
                if weight == 0.0 or importance == 0.0:
                    break
                continue
            flight = -math.log1p(-stream.random()) / sigma_t if sigma_t > 0.0 else math.inf
            wall = math.inf if uz == 0.0 else -pz / uz if uz < 0.0 else (thickness - pz) / uz
            if flight < wall:
                px, py, pz = px + flight * ux, py + flight * uy, pz + flight * uz
                weight, v = _roulette(stream, weight * albedo), phase_sample(v_nodes, steps, f[j], cdf[j], stream.random())
                if weight == 0.0:
                    break
                ux, uy, uz = turned_direction(ux, uy, uz, v, 2.0 * math.pi * stream.random())
                continue
            if wall == math.inf:
                break
            px, py, up = px + wall * ux, py + wall * uy, uz < 0.0
            if j == last and not up and base >= 0.0:
                (ux, uy, uz), pz, weight = _off_base(stream), thickness, _roulette(stream, weight * base)
                if weight == 0.0:
                    break
                continue
            ratio, alpha = faces[j if up else j + 1]
            passes, ux, uy, across = _cross(stream, ux, uy, abs(uz), 1.0 / ratio if up else ratio, alpha)
            if passes:
                if up and j == 0:
                    _tally(px * px + py * py, across, weight * importance, edges, light[into], square[into],
                           beyond[into:into + 1])
                j += -1 if up else 1
                if j < 0 or j > last:
                    break
            up, pz = up == passes, media[j, 2] if up == passes else 0.0
            uz = -across if up else across
