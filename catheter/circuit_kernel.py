"""The compiled circuit: Rodas5P steps with tridiagonal solves, their exact derivatives, dense output.

Everything compiled stands in this one file, because numba's cache does not see a change in another.

A circuit is a table (N, W), one row a segment, all SI: see the column names below. The state x (N,)
is V/V_rest - 1. A drive is m pieces: `breaks` (m+1,) in s, `pieces` (m, 4) the coefficients of
u = a + b s + c s^2 + d s^3 in Pa with s the seconds since the piece began.

Directions: besides x itself ("column" 0) M derivatives of x are carried, each along its own
tangent (2N,): relative changes of the N flow coefficients, then of the N stiffness factors. A Rosenbrock
step applied to the variational equation is the exact derivative of the step applied to x, so
these are derivatives of the numbers computed, not approximations beside them.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# columns of a circuit's table; the coefficients c0, c1, ... of the pressure fill the rest
PER_VOLUME, FLOW, TRANSITION, FORWARD, REVERSE, CRACKING, STIFFNESS, LOW, HIGH, FIRST = range(10)

DONE, TOO_MANY, UNDERFLOW, NOT_FINITE, EMPTIED = range(5)

LOCAL = 0.1  # a step's share of the tolerance, so that the sum of all steps, and the dense output, meet it
STAGES = 8
ORDER = 5
# Rodas5P: order 5(4), L-stable, stiffly accurate; dense output of order 4.
# G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P, BIT Numer. Math. 63:27 (2023).
GAMMA = 0.21193756319429014
_A6 = (-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946)
_A = (
    (),
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    _A6,
    (*_A6, 1.0),
    (*_A6, 1.0, 1.0),
)
_C = (
    (),
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471),
    (
        *(30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783),
        *(-19.097331116725623, -28.087943162872662),
    ),
    (
        *(37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047),
        *(-40.06618937091002, -54.66780262877968, -9.48861652309627),
    ),
)
A = np.array([[*row, *[0.0] * (STAGES - len(row))] for row in _A])
C = np.array([[*row, *[0.0] * (STAGES - len(row))] for row in _C])
ALPHA = np.array([0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0])
G = np.array([GAMMA, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069, 0.0, 0.0, 0.0])
H = np.array(
    [
        *(25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204),
        *(0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493),
        *(-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796),
        *(20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372),
        *(11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643),
        *(-52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722),
    ]
).reshape(3, STAGES)


@njit(cache=True, nogil=True, error_model="numpy")
def pressure(table: Array, k: int, x: float) -> tuple[float, float, float]:
    """Return P, P', P'' of accumulator k [Pa]: a polynomial (thesis eq. 3.3), linear beyond LOW and HIGH."""
    inside = min(max(x, table[k, LOW]), table[k, HIGH])
    p = slope = bend = 0.0
    for j in range(table.shape[1] - 1, FIRST - 1, -1):
        bend = bend * inside + 2 * slope
        slope = slope * inside + p
        p = p * inside + table[k, j]
    scale = table[k, STIFFNESS]
    if inside == x:
        return scale * p, scale * slope, scale * bend
    return scale * (p + slope * (x - inside)), scale * slope, 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _excess(table: Array, k: int, drop: float) -> float:
    """Return how far a drop is beyond the cracking pressure on its side; 0 while the valve is shut."""
    if drop > table[k, FORWARD]:
        return float(drop - table[k, FORWARD])
    if drop < -table[k, REVERSE]:
        return float(drop + table[k, REVERSE])
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def plain_flow(table: Array, k: int, drop: float) -> float:
    """Return the flow alone [m^3/s]."""
    d = table[k, TRANSITION]
    if table[k, CRACKING] == 0.0:
        return float(table[k, FLOW] * drop / np.sqrt(np.sqrt(drop * drop + d * d)))
    e = _excess(table, k, drop)
    w = e * e + d * d
    return float(table[k, FLOW] * e * abs(e) / (np.sqrt(w) * np.sqrt(np.sqrt(w))))


@njit(cache=True, nogil=True, error_model="numpy")
def flow(table: Array, k: int, drop: float) -> tuple[float, float, float]:
    """Return Q, Q', Q'' over the drop of valve k [m^3/s].

    Orifice: Q = K p/(p^2+d^2)^(1/4) (thesis eq. 3.7, laminar below the transition d). Cracking
    valve: Q = K e|e|/(e^2+d^2)^(3/4), e the drop beyond the cracking pressure.
    """
    factor, d = table[k, FLOW], table[k, TRANSITION]
    e = drop if table[k, CRACKING] == 0.0 else _excess(table, k, drop)
    w = e * e + d * d
    root = np.sqrt(np.sqrt(w))
    if table[k, CRACKING] == 0.0:
        lift, scale = 0.5 * e * e + d * d, factor / (w * root)
        return factor * e / root, lift * scale, e * (1.0 - 2.5 * lift / w) * scale
    scale = factor / (root * root * root)
    ratio = e * e / w
    return (
        e * abs(e) * scale,
        abs(e) * (2.0 - 1.5 * ratio) * scale,
        np.sign(e) * (2.0 - 7.5 * ratio + 5.25 * ratio * ratio) * scale,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def source_at(pieces: Array, i: int, s: float) -> tuple[float, float]:
    """Return u [Pa] and du/dt at s seconds into piece i."""
    a, b, c, d = pieces[i, 0], pieces[i, 1], pieces[i, 2], pieces[i, 3]
    return a + s * (b + s * (c + s * d)), b + s * (2 * c + 3 * s * d)


@njit(cache=True, nogil=True, error_model="numpy")
def _links(table: Array, x: Array, source: float, link: Array) -> None:
    """Set link (6, N) to P, P', P'' of each accumulator at x (N, ...) and Q, Q', Q'' of the valve before it."""
    before = source
    for k in range(len(table)):
        link[0, k], link[1, k], link[2, k] = pressure(table, k, x[k])
        link[3, k], link[4, k], link[5, k] = flow(table, k, before - link[0, k])
        before = link[0, k]


@njit(cache=True, nogil=True, error_model="numpy")
def _plain_links(table: Array, x: Array, source: float, link: Array) -> None:
    """Set only the rows P and Q of link (6, N)."""
    before, last = source, table.shape[1] - 1
    for k in range(len(table)):
        if table[k, LOW] <= x[k] <= table[k, HIGH]:
            here = table[k, last]
            for j in range(last - 1, FIRST - 1, -1):
                here = here * x[k] + table[k, j]
            here *= table[k, STIFFNESS]
        else:
            here = pressure(table, k, x[k])[0]
        link[0, k], link[3, k] = here, plain_flow(table, k, before - here)
        before = here


@njit(cache=True, nogil=True, error_model="numpy")
def _add_derivative(  # noqa: PLR0917, compiled functions take arrays, not objects
    table: Array, link: Array, s: Array, m: int, tangent: Array, out: Array, i: int
) -> None:
    """Add the derivative of dx/dt along column m of s and its tangent to out[i]."""
    n = len(table)
    before, at = 0.0, m * n
    for k in range(n):
        here = link[1, k] * s[at + k] + link[0, k] * tangent[m - 1, n + k]
        q = link[4, k] * (before - here) + link[3, k] * tangent[m - 1, k]
        out[i, at + k] += q * table[k, PER_VOLUME]
        if k > 0:
            out[i, at + k - 1] -= q * table[k - 1, PER_VOLUME]
        before = here


@njit(cache=True, nogil=True, error_model="numpy")
def _add_second(  # noqa: PLR0917
    table: Array, link: Array, s: Array, m: int, tangent: Array, source_v: float, out: Array, i: int
) -> None:
    """Add to out[i] the second derivative of dx/dt along (s, tangent) and along column 0 of out[i] with the source."""
    n = len(table)
    s_before, v_before, both_before, at = 0.0, source_v, 0.0, m * n
    for k in range(n):
        stiffer, v = tangent[m - 1, n + k], out[i, k]
        s_here = link[1, k] * s[at + k] + link[0, k] * stiffer
        v_here = link[1, k] * v
        both_here = (link[2, k] * s[at + k] + link[1, k] * stiffer) * v
        v_drop, wider = v_before - v_here, tangent[m - 1, k]
        q = (link[5, k] * (s_before - s_here) + link[4, k] * wider) * v_drop + link[4, k] * (both_before - both_here)
        out[i, at + k] += q * table[k, PER_VOLUME]
        if k > 0:
            out[i, at + k - 1] -= q * table[k - 1, PER_VOLUME]
        s_before, v_before, both_before = s_here, v_here, both_here


@njit(cache=True, nogil=True, error_model="numpy")
def _factor(table: Array, link: Array, shift: float, lu: Array) -> None:
    """Factor shift - J, tridiagonal, into lu (3, N): lower factor, 1/pivot, upper entry.

    J is a compartment matrix and shift > 0, so the pivots stay positive without exchanging rows.
    """
    n = len(table)
    for k in range(n):
        diagonal = link[4, k]
        if k + 1 < n:
            diagonal += link[4, k + 1]
            lu[2, k] = -link[4, k + 1] * link[1, k + 1] * table[k, PER_VOLUME]
        diagonal = shift + diagonal * link[1, k] * table[k, PER_VOLUME]
        if k > 0:
            lu[0, k] = -link[4, k] * link[1, k - 1] * table[k, PER_VOLUME] * lu[1, k - 1]
            diagonal -= lu[0, k] * lu[2, k - 1]
        lu[1, k] = 1.0 / diagonal


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(lu: Array, b: Array, i: int, at: int) -> None:
    """Solve in place for b[i, at : at + N]."""
    n = lu.shape[1]
    for k in range(1, n):
        b[i, at + k] -= lu[0, k] * b[i, at + k - 1]
    b[i, at + n - 1] *= lu[1, n - 1]
    for k in range(n - 2, -1, -1):
        b[i, at + k] = (b[i, at + k] - lu[2, k] * b[i, at + k + 1]) * lu[1, k]


@njit(cache=True, nogil=True, error_model="numpy")
def _stages(  # noqa: PLR0917
    table: Array,
    pieces: Array,
    index: int,
    s: float,
    h: float,
    z: Array,
    tangent: Array,
    base: Array,
    link: Array,
    lu: Array,
    y: Array,
    u: Array,
) -> None:
    """Set u (8, (1+M) N), the stages of one step of h seconds from z ((1+M) N,); `base` (6, N) belongs to z."""
    n = len(table)
    rate, per_h, size = source_at(pieces, index, s)[1], 1.0 / h, len(z)
    _factor(table, base, 1.0 / (GAMMA * h), lu)
    push = base[4, 0] * rate * table[0, PER_VOLUME] * h
    for i in range(STAGES):
        for k in range(size):
            y[k] = z[k]
            u[i, k] = 0.0
        for j in range(i):
            a, c = A[i, j], C[i, j] * per_h
            for k in range(size):
                y[k] += a * u[j, k]
                u[i, k] += c * u[j, k]
        source = source_at(pieces, index, s + ALPHA[i] * h)[0]
        if size > n:
            _links(table, y, source, link)
        else:
            _plain_links(table, y, source, link)
        for k in range(n):
            onward = link[3, k + 1] if k + 1 < n else 0.0
            u[i, k] += (link[3, k] - onward) * table[k, PER_VOLUME]
        u[i, 0] += G[i] * push
        _solve(lu, u, i, 0)
        for m in range(1, size // n):
            _add_derivative(table, link, y, m, tangent, u, i)
            _add_second(table, base, z, m, tangent, G[i] * h * rate, u, i)
            _solve(lu, u, i, m * n)


@njit(cache=True, nogil=True, error_model="numpy")
def _grown(array: Array) -> Array:
    larger = np.empty((2 * len(array), *array.shape[1:]))
    old, new = array.reshape(-1), larger.reshape(-1)
    for i in range(len(old)):  # a slice would do, but takes a second to compile
        new[i] = old[i]
    return larger


@njit(cache=True, nogil=True, error_model="numpy")
def _first_step(table: Array, link: Array, tolerance: float, length: float) -> float:
    """Return a first step after a jump, from the fastest change of a volume."""
    n, fastest = len(table), 1e-300
    for k in range(n):
        onward = link[3, k + 1] if k + 1 < n else 0.0
        fastest = max(fastest, abs(link[3, k] - onward) * table[k, PER_VOLUME])
    return float(min(0.1 * tolerance ** (1.0 / ORDER) / fastest, length))


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(  # noqa: PLR0917
    table: Array, x: Array, source: float, link: Array, tolerance: float, weight: Array
) -> None:
    """Set weight (N,), the error a step may make in x: the tolerance, but no more than half a drop's worth of volume.

    A volume that errs by more than the drops beside it pushes the flow to and fro across the
    laminar range, and the steps never grow again.
    """
    n, before = len(table), source
    for k in range(n):
        drop, d = before - link[0, k], table[k, TRANSITION]
        size = np.sqrt(drop * drop + d * d)
        most = 0.5 * size / link[1, k]
        weight[k] = min(tolerance * max(1.0, abs(1.0 + x[k])), most)
        if k > 0:
            weight[k - 1] = min(weight[k - 1], 0.5 * size / link[1, k - 1])
        before = link[0, k]


@njit(cache=True, nogil=True, error_model="numpy")
def integrate(  # noqa: PLR0912, PLR0917, one loop reads better than its parts
    table: Array, breaks: Array, pieces: Array, start: Array, tangent: Array, tolerance: float, most: int
) -> tuple[int, int, int, int, Array, Array, Array, Array]:
    """Integrate from start ((1+M) N,) over all pieces of the drive, restarting at every break.

    Returns status, where (the segment at fault, or -1), steps taken, steps tried, and per step its
    time, width, columns (steps+1, (1+M) N) and dense output (steps, 3, (1+M) N). The estimated
    error of a step in V/V_rest, relative above 1, stays below `tolerance` times LOCAL (see `_weigh`).
    """
    tolerance = tolerance * LOCAL
    size, n = len(start), len(table)
    capacity = 128
    time, width = np.empty(capacity), np.empty(capacity)
    state, dense = np.empty((capacity + 1, size)), np.empty((capacity, 3, size))
    base, link, lu = np.empty((6, n)), np.empty((6, n)), np.empty((3, n))
    y, z, u, weight = np.empty(size), start.copy(), np.empty((STAGES, size)), np.empty(n)
    state[0] = start
    count = tried = 0
    h, before = 0.0, np.nan
    for index in range(len(pieces)):
        length, s = breaks[index + 1] - breaks[index], 0.0
        source = source_at(pieces, index, 0.0)[0]
        _links(table, z, source, base)
        _weigh(table, z, source, base, tolerance, weight)
        if not abs(source - before) <= 1e-9 * abs(source):
            h = _first_step(table, base, tolerance, length)
        while s < length:
            last = s + 1.01 * h >= length
            step = length - s if last else h
            tried += 1
            if tried > most or step < 1e-15 * s or step < 1e-250:
                status = TOO_MANY if tried > most else UNDERFLOW
                return status, -1, count, tried, time, width, state, dense
            _stages(table, pieces, index, s, step, z, tangent, base, link, lu, y, u)
            error = 0.0
            for k in range(n):
                ratio = abs(u[STAGES - 1, k]) / weight[k]
                error = ratio if not ratio <= error else error
            factor = 0.9 * max(error, 1e-12) ** (-1.0 / ORDER) if np.isfinite(error) else 0.1
            if not error <= 1.0:
                h = step * max(0.1, factor)
                continue
            h = max(h, step * min(8.0, factor)) if last else step * min(8.0, factor)
            if count == capacity:
                time, width, dense, state = _grown(time), _grown(width), _grown(dense), _grown(state)
                capacity *= 2
            time[count], width[count] = breaks[index] + s, step
            for i in range(3):
                for k in range(size):
                    dense[count, i, k] = 0.0
                for j in range(STAGES):
                    for k in range(size):
                        dense[count, i, k] += H[i, j] * u[j, k]
            count += 1
            for k in range(size):
                z[k] = y[k] + u[STAGES - 1, k]
                state[count, k] = z[k]
            for k in range(n):
                if not z[k] > -1.0:
                    return (EMPTIED if z[k] <= -1.0 else NOT_FINITE), k, count, tried, time, width, state, dense
            s = length if last else s + step
            before = source_at(pieces, index, s)[0]
            _links(table, z, before, base)
            _weigh(table, z, before, base, tolerance, weight)
    return DONE, -1, count, tried, time, width, state, dense


@njit(cache=True, nogil=True, error_model="numpy")
def rest_at(table: Array, k: int, target: float) -> float:
    """Return the x at which accumulator k holds a pressure [Pa]: Newton's method, kept in a bracket by bisection.

    Returns -1 where the pressure would empty it, inf where 2^20 rest volumes do not hold it.
    """
    low, high = -1.0, 1.0
    if pressure(table, k, low)[0] >= target:
        return low
    while pressure(table, k, high)[0] < target:
        if high > 1e6:
            return np.inf
        low, high = high, 2.0 * high
    x = 0.5 * (low + high)
    for _ in range(100):
        p, slope, _ = pressure(table, k, x)
        if p < target:
            low = x
        else:
            high = x
        newton = x - (p - target) / slope
        if abs(newton - x) <= 1e-15:
            break
        x = newton if low < newton < high else 0.5 * (low + high)
    return x


@njit(cache=True, nogil=True, error_model="numpy")
def slopes(table: Array, x: Array, source: float, out: Array, jacobian: Array) -> None:
    """Set out (N,) to dx/dt and jacobian (N, N) to its derivative, for solvers other than ours."""
    n = len(table)
    link = np.empty((6, n))
    _links(table, x, source, link)
    for k in range(n):
        onward = k + 1 < n
        out[k] = (link[3, k] - (link[3, k + 1] if onward else 0.0)) * table[k, PER_VOLUME]
        jacobian[k, k] = -(link[4, k] + (link[4, k + 1] if onward else 0.0)) * link[1, k] * table[k, PER_VOLUME]
        if k > 0:
            jacobian[k, k - 1] = link[4, k] * link[1, k - 1] * table[k, PER_VOLUME]
        if onward:
            jacobian[k, k + 1] = link[4, k + 1] * link[1, k + 1] * table[k, PER_VOLUME]


@njit(cache=True, nogil=True, error_model="numpy")
def flows(table: Array, x: Array, source: Array) -> Array:
    """Return the flow through each valve [m^3/s], (m, N), for states x (m, N) and sources (m,)."""
    out, link = np.empty_like(x), np.empty((6, len(table)))
    for i in range(len(x)):
        _links(table, x[i], source[i], link)
        out[i] = link[3]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def between(state: Array, dense: Array, i: int, a: float, column: int) -> tuple[float, float]:
    """Return one column of the dense output at share a of step i, and its derivative by a."""
    y0, y1 = state[i, column], state[i + 1, column]
    d1, d2, d3 = dense[i, 0, column], dense[i, 1, column], dense[i, 2, column]
    inner, inner_slope = d1 + a * (d2 + a * d3), d2 + 2.0 * a * d3
    value = (1.0 - a) * y0 + a * (y1 + (1.0 - a) * inner)
    return value, y1 - y0 + (1.0 - 2.0 * a) * inner + a * (1.0 - a) * inner_slope


@njit(cache=True, nogil=True, error_model="numpy")
def crossing(  # noqa: PLR0917
    state: Array, dense: Array, steps: int, column: int, level: float, rising: bool
) -> tuple[int, float]:
    """Return the step, and the share of it, at which a column first passes a level; step -1 if it never does."""
    sign = 1.0 if rising else -1.0
    for i in range(steps):
        if sign * (state[i, column] - level) < 0.0 <= sign * (state[i + 1, column] - level):
            low, high = 0.0, 1.0
            a = 0.5
            for _ in range(60):
                value, slope = between(state, dense, i, a, column)
                if sign * (value - level) < 0.0:
                    low = a
                else:
                    high = a
                newton = a - (value - level) / slope
                if not low < newton < high:
                    newton = 0.5 * (low + high)
                if abs(newton - a) < 1e-15:
                    break
                a = newton
            return i, a
    return -1, np.nan


@njit(cache=True, nogil=True, error_model="numpy")
def bounds(table: Array, breaks: Array, pieces: Array) -> tuple[Array, Array]:
    """Return the states (N,) at rest under the least and the most pressure of a drive.

    The circuit is a monotone system, so every periodic state lies between them.
    """
    least, most = np.inf, -np.inf
    for i in range(len(pieces)):
        length = breaks[i + 1] - breaks[i]
        for j in range(9):
            u = source_at(pieces, i, length * j / 8.0)[0]
            least, most = min(least, u), max(most, u)
    n = len(table)
    lower, upper = np.empty(n), np.empty(n)
    for k in range(n):
        lower[k], upper[k] = rest_at(table, k, least), rest_at(table, k, most)
    return lower, upper


@njit(cache=True, nogil=True, error_model="numpy")
def balance(table: Array, breaks: Array, pieces: Array, lower: Array, upper: Array) -> Array:
    """Return the state (N,) at rest under the pressure at which valve 1 lets as much in as out over a cycle.

    That is the periodic state of a fast cycle, but for its ripple.
    """
    n = len(table)
    x = np.empty(n)
    low, high = pressure(table, 0, lower[0])[0], pressure(table, 0, upper[0])[0]
    for _ in range(60):
        middle, inflow = 0.5 * (low + high), 0.0
        for i in range(len(pieces)):
            length = breaks[i + 1] - breaks[i]
            for j in range(8):
                u = source_at(pieces, i, length * (j + 0.5) / 8.0)[0]
                inflow += length * plain_flow(table, 0, u - middle)
        low, high = (middle, high) if inflow > 0.0 else (low, middle)
    for k in range(n):
        x[k] = rest_at(table, k, 0.5 * (low + high))
    return x


@njit(cache=True, nogil=True, error_model="numpy")
def _newton(end: Array, gap: Array) -> Array:
    """Return (1 - D)^-1 gap for the derivative D of the end state, whose column j is end[(1+j) N : (2+j) N].

    Gauss elimination with row exchanges; numpy's costs seconds to compile. A direction that the
    cycle does not bring back at all (a shut valve) keeps its gap.
    """
    n = len(gap)
    a, x = np.empty((n, n)), gap.copy()
    for i in range(n):
        for j in range(n):
            a[i, j] = (1.0 if i == j else 0.0) - end[(1 + j) * n + i]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            best = i if abs(a[i, k]) > abs(a[best, k]) else best
        for j in range(n):
            a[k, j], a[best, j] = a[best, j], a[k, j]
        x[k], x[best] = x[best], x[k]
        if abs(a[k, k]) < 1e-12:
            return gap
        for i in range(k + 1, n):
            factor = a[i, k] / a[k, k]
            for j in range(k, n):
                a[i, j] -= factor * a[k, j]
            x[i] -= factor * x[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= a[k, j] * x[j]
        x[k] /= a[k, k]
    return x


@njit(cache=True, nogil=True, error_model="numpy")
def _largest(x: Array) -> float:
    """Return max |x|; NaN if one is."""
    most = 0.0
    for k in range(len(x)):
        most = abs(x[k]) if not abs(x[k]) <= most else most
    return most


@njit(cache=True, nogil=True, error_model="numpy")
def periodic(  # noqa: PLR0917
    table: Array,
    breaks: Array,
    pieces: Array,
    guess: Array,
    plain: int,
    closing: float,
    settle: float,
    most_cycles: int,
    tolerance: float,
    most: int,
) -> tuple[int, int, int, float, float, Array, int, int, Array, Array, Array, Array]:
    """Find the state (N,) that a cycle of the drive brings back, and run that cycle.

    The first `plain` cycles merely go on from the last one's end, as long as each closes ten times
    better than the one before; `closing` is that ratio where it is known beforehand, else 1. After
    that Newton's method on x(T) - x(0) = 0, with the exact derivative of x(T) by x(0); a step that
    does not help is shortened. Stops when the state is known to `settle`: the Newton step, not the
    gap x(T) - x(0), which at high frequency is far smaller than the error.

    Returns status, where, cycles run, the error of the state, that ratio, the state, then what
    `integrate` returns of the last cycle from its steps on. Not settled: the error is above `settle`.
    """
    n = len(table)
    lower, upper = bounds(table, breaks, pieces)
    x, step, gap = guess.copy(), np.zeros(n), np.zeros(n)
    sensitive, before, error, share, cycle = plain == 0, np.inf, np.inf, 1.0, 0
    while True:
        columns = n + n * n if sensitive else n
        start = np.zeros(columns)
        for k in range(n):
            x[k] = min(max(x[k], lower[k]), upper[k])
            start[k] = x[k]
            if sensitive:
                start[n + k * n + k] = 1.0
        tangent = np.zeros((n if sensitive else 0, 2 * n))
        found = integrate(table, breaks, pieces, start, tangent, tolerance, most)
        cycle += 1
        if found[0] != DONE:
            return found[0], found[1], cycle, np.inf, closing, x, *found[2:]
        end = found[6][found[2]]
        for k in range(n):
            gap[k] = end[k] - x[k]
        size, newton = _largest(gap), gap
        if sensitive and np.isfinite(_largest(end)):
            newton = _newton(end, gap)
            error = _largest(newton)
        else:
            closing = closing if cycle == 1 else size / before
            doubt = 4.0 if cycle == 1 else 1.0  # what was known beforehand may be somewhat wrong here
            error = doubt * size / (1.0 - closing) if closing < 0.5 else (np.inf if size > 0.0 else 0.0)
        if error <= settle or cycle >= most_cycles:
            return found[0], found[1], cycle, error, closing, x, *found[2:]
        if sensitive and not size < before and share > 0.2:  # too far: take back all but a quarter of the last step
            share *= 0.25
            for k in range(n):
                x[k] -= 0.75 * step[k]
                step[k] *= 0.25
            continue
        share = 1.0
        for k in range(n):
            step[k] = newton[k]
            x[k] += step[k]
        sensitive = sensitive or cycle >= plain or (cycle > 1 and not size < 0.1 * before)
        before = size


@njit(cache=True, nogil=True, error_model="numpy")
def many(  # noqa: PLR0917
    tables: Array,
    breaks: Array,
    pieces: Array,
    columns: Integers,
    levels: Array,
    watched: int,
    settle: float,
    most_cycles: int,
    tolerance: float,
    most: int,
) -> tuple[Array, Array, Integers]:
    """Bring many circuits (C, N, W) under drives (C, m+1), (C, m, 4) to their periodic states, and find events.

    Event j is state column columns[j] passing levels[1, j], upwards where levels[0, j] > 0. Each
    circuit starts from the states of the three before, so neighbours should be alike. Returns
    event times (C, events), the watched column then, and per circuit cycles run, negative if it failed.
    """
    count, n = len(tables), tables.shape[1]
    events = len(columns)
    times, values = np.full((count, events), np.nan), np.full((count, events), np.nan)
    cycles = np.zeros(count, np.int64)
    lower, upper = bounds(tables[0], breaks[0], pieces[0])
    guess, known = balance(tables[0], breaks[0], pieces[0], lower, upper), 0
    last, closing = np.empty((3, n)), 1.0
    for c in range(count):
        if known > 0:
            for k in range(n):
                guess[k] = last[0, k] if known < 3 else 3.0 * (last[0, k] - last[1, k]) + last[2, k]
        status, _, run, error, closing, _, steps, _, time, width, state, dense = periodic(
            tables[c], breaks[c], pieces[c], guess, most_cycles, closing, settle, most_cycles, tolerance, most
        )
        if status != DONE or error > settle:
            cycles[c], known = -run, 0
            continue
        cycles[c], known = run, known + 1
        for k in range(n):
            last[2, k], last[1, k], last[0, k] = last[1, k], last[0, k], state[steps, k]
        for j in range(events):
            i, a = crossing(state, dense, steps, columns[j], levels[1, j], levels[0, j] > 0.0)
            if i >= 0:
                times[c, j] = time[i] + a * width[i]
                values[c, j] = between(state, dense, i, a, watched)[0]
    return times, values, cycles
