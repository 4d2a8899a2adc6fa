"""FMUs of another tool for tests: machines in CasADi, as it exports them (FMI 3.0, Model Exchange, sources only).

``python tests/casadi_machines.py tests/reference`` writes ``casadi_stage.zip`` and ``casadi_crane.zip``. It needs
CasADi (``pip install casadi==3.8.2``), which the tests do not: :func:`fmus.compiled` makes FMUs of these files.
"""

import os
import sys
import tempfile
import zipfile
from pathlib import Path

import casadi as ca


def stage() -> ca.DaeBuilder:
    """``two_mass_stage`` of the package, with units as FMI writes them."""
    d = ca.DaeBuilder("stage")
    parameters = [("K_f", 12.0, "N/V"), ("m_c", 4.0, "kg"), ("m_t", 2.5, "kg"), ("k", 2.5e4, "N/m"),
                  ("c", 15.0, "N.s/m")]  # fmt: skip
    K_f, m_c, m_t, k, c = (d.add(n, "parameter", "tunable", {"start": v, "unit": unit}) for n, v, unit in parameters)
    inputs = [("u", "V"), ("F_c", "N"), ("F_t", "N")]
    u, F_c, F_t = (d.add(n, "input", {"start": 0.0, "unit": unit}) for n, unit in inputs)
    x_c, x_t = (d.add(n, {"start": 0.0, "unit": "m"}) for n in ("x_c", "x_t"))
    v_c, v_t = (d.add(n, {"start": 0.0, "unit": "m/s"}) for n in ("v_c", "v_t"))
    pull = k * (x_t - x_c) + c * (v_t - v_c)
    d.eq(d.der(x_c), v_c)
    d.eq(d.der(x_t), v_t)
    d.eq(d.der(v_c), (K_f * u + F_c + pull) / m_c)
    d.eq(d.der(v_t), (F_t - pull) / m_t)
    return d


def crane() -> ca.DaeBuilder:
    """A load on a rope below a trolley, pulled by a motor with a winding; dots and brackets in names, no units."""
    d = ca.DaeBuilder("crane")

    def parameter(name: str, value: float) -> ca.MX:
        return d.add(name, "parameter", "tunable", {"start": value})

    M, m, L = parameter("trolley.mass", 60.0), parameter("load.mass", 20.0), parameter("rope.length", 1.2)
    D = [parameter("damping[1]", 25.0), parameter("damping[2]", 0.8)]
    R, H, kt = parameter("motor.R", 0.8), parameter("motor.L", 4e-3), parameter("motor.k", 40.0)
    u = d.add("volts", "input", {"start": 0.0})
    F = [d.add(f"F[{k}]", "input", {"start": 0.0}) for k in (1, 2)]
    q = [d.add(f"crane.q[{k}]", {"start": 0.0}) for k in (1, 2)]
    v = [d.add(f"crane.v[{k}]", {"start": 0.0}) for k in (1, 2)]
    i = d.add("motor.i", {"start": 0.0})
    a11, a12, a22 = M + m, m * L * ca.cos(q[1]), m * L * L
    f1 = kt * i - D[0] * v[0] + F[0] + m * L * ca.sin(q[1]) * v[1] ** 2
    f2 = F[1] - D[1] * v[1] - m * 9.81 * L * ca.sin(q[1])
    for state, rate in zip(
        [*q, *v, i],
        [*v, (a22 * f1 - a12 * f2) / (a11 * a22 - a12**2), (a11 * f2 - a12 * f1) / (a11 * a22 - a12**2),
         (u - R * i - kt * v[0]) / H],
        strict=True,
    ):  # fmt: skip
        d.eq(d.der(state), rate)
    d.add("hook.x", "output", {})
    d.eq(d.var("hook.x"), q[0] + L * ca.sin(q[1]))
    return d


if __name__ == "__main__":
    target = Path(sys.argv[1]).resolve()
    for machine in (stage(), crane()):
        os.chdir(tempfile.mkdtemp())
        files = machine.export_fmu({"no_warning": True, "with_serialization": False})
        with zipfile.ZipFile(target / f"casadi_{machine.name()}.zip", "w", zipfile.ZIP_DEFLATED) as out:
            for there, name in files.items():
                out.write(there, name)
