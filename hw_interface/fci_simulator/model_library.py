"""The model library that a control box hands to libfranka: a shared object, written in C from the robot's description.

A real box sends a library made by Franka for its own arm; libfranka looks up 30 symbols in it (`libfcimodels.h`,
`model_library.cpp` of 0.9.2) and computes dynamics with them. Here the same symbols are computed from the URDF that the
simulation is built from: joints 1 to 7 and the links behind them, the hand not counted, because libfranka passes what
hangs at the flange with every call. Inertia of motors and friction are not part of it.

Conventions: matrices by columns; Jacobians 6 x 7, linear over angular, in the axes of the base (`O_J_*`) or of the
frame itself (`Ji_J_*`); frames 1 to 7 are the joints, 8 the flange, 9 the end effector.
"""

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from control.errors import MachineError
from control.robot.description import FLANGE_FRAME

COMPILE_TIME = 60.0  # [s]

# Newton-Euler in the frames of the links (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 5.3), with the
# base accelerated against gravity. R0, P0: pose of each joint in the one before at q = 0; MASS, COM, INERTIA: of each
# link in its own frame; FLANGE: position of the flange behind joint 7, whose axes it has.
_BODY = r"""
typedef struct { double R[10][9]; double p[10][3]; } Frames;

static void mul(const double *A, const double *B, double *C) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      C[3*i+j] = A[3*i]*B[j] + A[3*i+1]*B[3+j] + A[3*i+2]*B[6+j];
}
static void rotate(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] = A[3*i]*x[0] + A[3*i+1]*x[1] + A[3*i+2]*x[2];
}
static void unrotate(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] = A[i]*x[0] + A[3+i]*x[1] + A[6+i]*x[2];
}
static void cross(const double *a, const double *b, double *c) {
  c[0] = a[1]*b[2] - a[2]*b[1];
  c[1] = a[2]*b[0] - a[0]*b[2];
  c[2] = a[0]*b[1] - a[1]*b[0];
}
static void joint(int i, double q, double *R) {
  const double c = cos(q), s = sin(q), Z[9] = {c, -s, 0, s, c, 0, 0, 0, 1};
  mul(R0[i], Z, R);
}
static void place(const double *R, const double *p, const double *offset, double *out) {
  rotate(R, offset, out);
  for (int k = 0; k < 3; k++) out[k] += p[k];
}
/* Frames 0..6: joints, 7: flange, 8: end effector (if F_T_EE is given). */
static void chain(const double *q, const double *F_T_EE, Frames *f) {
  double R[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, p[3] = {0, 0, 0}, L[9];
  for (int i = 0; i < 7; i++) {
    place(R, p, P0[i], f->p[i]);
    joint(i, q[i], L);
    mul(R, L, f->R[i]);
    memcpy(R, f->R[i], sizeof R);
    memcpy(p, f->p[i], sizeof p);
  }
  memcpy(f->R[7], R, sizeof R);
  place(R, p, FLANGE, f->p[7]);
  if (F_T_EE) {
    double T[9];
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) T[3*i+j] = F_T_EE[4*j+i];
    mul(R, T, f->R[8]);
    place(R, f->p[7], F_T_EE + 12, f->p[8]);
  }
}
static void pose(const double *q, const double *F_T_EE, int n, double *out) {
  Frames f;
  chain(q, F_T_EE, &f);
  memset(out, 0, 16 * sizeof *out);
  for (int j = 0; j < 3; j++)
    for (int i = 0; i < 3; i++) out[4*j+i] = f.R[n][3*i+j];
  memcpy(out + 12, f.p[n], sizeof f.p[n]);
  out[15] = 1;
}
static void jacobian(const double *q, const double *F_T_EE, int n, int own_axes, double *out) {
  Frames f;
  chain(q, F_T_EE, &f);
  memset(out, 0, 42 * sizeof *out);
  for (int i = 0; i < 7 && i <= n; i++) {
    const double z[3] = {f.R[i][2], f.R[i][5], f.R[i][8]};
    double arm[3], v[3], *column = out + 6*i;
    for (int k = 0; k < 3; k++) arm[k] = f.p[n][k] - f.p[i][k];
    cross(z, arm, v);
    if (own_axes) {
      unrotate(f.R[n], v, column);
      unrotate(f.R[n], z, column + 3);
    } else {
      memcpy(column, v, sizeof v);
      memcpy(column + 3, z, sizeof z);
    }
  }
}
/* Adds force f and moment n (about the link's origin) that moving one body takes. */
static void body(double m, const double *c, const double *I, const double *w, const double *dw, const double *a,
                 double *f, double *n) {
  double x[3], y[3], z[3], force[3], Idw[3], Iw[3];
  cross(dw, c, x);
  cross(w, c, y);
  cross(w, y, z);
  for (int k = 0; k < 3; k++) force[k] = m * (a[k] + x[k] + z[k]);
  rotate(I, dw, Idw);
  rotate(I, w, Iw);
  cross(w, Iw, x);
  cross(c, force, y);
  for (int k = 0; k < 3; k++) {
    f[k] += force[k];
    n[k] += Idw[k] + x[k] + y[k];
  }
}
static void newton_euler(const double *q, const double *dq, const double *ddq, const double *g, const double *I_load,
                         double m_load, const double *x_load, double *tau) {
  double w[3] = {0, 0, 0}, dw[3] = {0, 0, 0}, a[3] = {-g[0], -g[1], -g[2]};
  double R[7][9], f[7][3], n[7][3];
  memset(f, 0, sizeof f);
  memset(n, 0, sizeof n);
  for (int i = 0; i < 7; i++) {
    double u[3], x[3], y[3], z[3];
    cross(dw, P0[i], x);
    cross(w, P0[i], y);
    cross(w, y, z);
    for (int k = 0; k < 3; k++) u[k] = a[k] + x[k] + z[k];
    joint(i, q[i], R[i]);
    unrotate(R[i], u, a);
    unrotate(R[i], w, x);
    unrotate(R[i], dw, y);
    const double spin[3] = {0, 0, dq[i]};
    cross(x, spin, z);
    for (int k = 0; k < 3; k++) { w[k] = x[k] + spin[k]; dw[k] = y[k] + z[k]; }
    dw[2] += ddq[i];
    body(MASS[i], COM[i], INERTIA[i], w, dw, a, f[i], n[i]);
    if (i == 6 && m_load > 0) {
      double I[9] = {0}, c[3];
      for (int k = 0; k < 3; k++) c[k] = x_load[k] + FLANGE[k];
      if (I_load)
        for (int r = 0; r < 3; r++)
          for (int s = 0; s < 3; s++) I[3*r+s] = I_load[3*s+r];
      body(m_load, c, I, w, dw, a, f[i], n[i]);
    }
  }
  for (int i = 6; i >= 0; i--) {
    tau[i] = n[i][2];
    if (i > 0) {
      double force[3], moment[3], lever[3];
      rotate(R[i], f[i], force);
      rotate(R[i], n[i], moment);
      cross(P0[i], force, lever);
      for (int k = 0; k < 3; k++) { f[i-1][k] += force[k]; n[i-1][k] += moment[k] + lever[k]; }
    }
  }
}
static const double ZERO[7] = {0};

void M_NE(const double *q, const double *I, double m, const double *x, double *M) {
  for (int j = 0; j < 7; j++) {
    double one[7] = {0};
    one[j] = 1;
    newton_euler(q, ZERO, one, ZERO, I, m, x, M + 7*j);
  }
}
void c_NE(const double *q, const double *dq, const double *I, double m, const double *x, double *c) {
  newton_euler(q, dq, ZERO, ZERO, I, m, x, c);
}
void g_NE(const double *q, const double *g, double m, const double *x, double *out) {
  newton_euler(q, ZERO, ZERO, g, 0, m, x, out);
}
void O_T_J9(const double *q, const double *F, double *b) { pose(q, F, 8, b); }
void O_J_J9(const double *q, const double *F, double *b) { jacobian(q, F, 8, 0, b); }
void Ji_J_J9(const double *q, const double *F, double *b) { jacobian(q, F, 8, 1, b); }
/* The first joint's own motion does not depend on q, which is not passed. */
void O_J_J1(double *b) { jacobian(ZERO, 0, 0, 0, b); }
void Ji_J_J1(double *b) { jacobian(ZERO, 0, 0, 1, b); }
void O_T_J1(const double *q, double *b) { pose(q, 0, 0, b); }
"""


def library_source(model: Any) -> str:
    """The library in C.

    Args:
        model: Pinocchio model of exactly the seven joints, with the flange's frame; see `arm.Arm.model`.
    """
    joints = range(1, 8)
    tables = {
        "R0[7][9]": [model.jointPlacements[i].rotation for i in joints],
        "P0[7][3]": [model.jointPlacements[i].translation for i in joints],
        "MASS[7]": [model.inertias[i].mass for i in joints],
        "COM[7][3]": [model.inertias[i].lever for i in joints],
        "INERTIA[7][9]": [model.inertias[i].inertia for i in joints],
        "FLANGE[3]": model.frames[model.getFrameId(FLANGE_FRAME)].placement.translation,
    }
    lines = ["#include <math.h>", "#include <string.h>"]
    lines += [f"static const double {name} = {_braces(np.asarray(values))};" for name, values in tables.items()]
    lines.append(_BODY)
    for n in range(2, 9):
        lines += [
            f"void O_T_J{n}(const double *q, double *b) {{ pose(q, 0, {n - 1}, b); }}",
            f"void O_J_J{n}(const double *q, double *b) {{ jacobian(q, 0, {n - 1}, 0, b); }}",
            f"void Ji_J_J{n}(const double *q, double *b) {{ jacobian(q, 0, {n - 1}, 1, b); }}",
        ]
    return "\n".join(lines) + "\n"


def build_library(model: Any) -> bytes:
    """The library as a shared object for this machine.

    Raises:
        MachineError: There is no C compiler, or it fails.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        raise MachineError(
            "no C compiler 'cc' on this machine: the simulated control box offers no model library, everything else "
            "works; to have it, install one (Debian, Ubuntu: apt install gcc libc6-dev)"
        )
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "model.c"), Path(folder, "model.so")
        source.write_text(library_source(model))
        command = [compiler, "-O2", "-std=c99", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=COMPILE_TIME)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise MachineError(f"the C compiler {compiler} could not build the model library: {error}") from error
        if done.returncode != 0:
            raise MachineError(f"the C compiler {compiler} could not build the model library: {done.stderr[-500:]}")
        return library.read_bytes()


def _braces(values: np.ndarray) -> str:
    """As a C initializer."""
    if values.ndim > 1:
        rows = ",\n  ".join(_braces(np.asarray(v).ravel()) for v in values)
        return f"{{{rows}}}"
    return "{" + ", ".join(repr(float(v)) for v in values) + "}"
