/* The strapdown's step in plain C: what `gateway.nav.strapdown` is measured against.
 *
 * Same mathematics, same block structure: mean (40), covariance (N, N), one row of increments (8),
 * as that module describes them. The equations are those of docs/math.md.
 */
#include <math.h>
#include <string.h>

#ifndef N
#define N 21
#endif

static const double A = 6378137.0, F = 1.0 / 298.257223563, GM = 3.986004418e14;
static const double OMEGA_IE = 7.292115e-5, GAMMA_E = 9.7803253359, SOMIGLIANA_K = 0.00193185265241;
static const double GAP_TURN = 0.05 * 0.05, GAP_FORCE = 0.3 * 0.3, TILTED_S = 10.0;

static void gravity(const double r[3], double g[3])  /* (M.10) */
{
    const double b = A * (1.0 - F), e2 = F * (2.0 - F), m = OMEGA_IE * OMEGA_IE * A * A * b / GM;
    double p = hypot(r[0], r[1]), t = atan2(r[2] * A, p * b), st = sin(t), ct = cos(t);
    double lat = atan2(r[2] + e2 / (1.0 - e2) * b * st * st * st, p - e2 * A * ct * ct * ct);
    double s = sin(lat), c = cos(lat), w = sqrt(1.0 - e2 * s * s);
    double h = p * c + r[2] * s - A * w;
    double g0 = GAMMA_E * (1.0 + SOMIGLIANA_K * s * s) / w;
    double gh = g0 * (1.0 - 2.0 / A * (1.0 + F + m - 2.0 * F * s * s) * h + 3.0 * h * h / (A * A));
    g[0] = p > 0.0 ? -gh * c * r[0] / p : 0.0;
    g[1] = p > 0.0 ? -gh * c * r[1] / p : 0.0;
    g[2] = -gh * s;
}

static void rotate(double *restrict C, const double phi[3], double earth)  /* (M.11) */
{
    double t2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2], a, b;
    if (t2 < 1e-8) {
        a = 1.0 - t2 / 6.0;
        b = 0.5 - t2 / 24.0;
    } else {
        double t = sqrt(t2);
        a = sin(t) / t;
        b = (1.0 - cos(t)) / t2;
    }
    double x = a * phi[0], y = a * phi[1], z = a * phi[2];
    double xy = b * phi[0] * phi[1], xz = b * phi[0] * phi[2], yz = b * phi[1] * phi[2];
    double e00 = 1.0 - b * (phi[1] * phi[1] + phi[2] * phi[2]);
    double e11 = 1.0 - b * (phi[0] * phi[0] + phi[2] * phi[2]);
    double e22 = 1.0 - b * (phi[0] * phi[0] + phi[1] * phi[1]);
    for (int i = 0; i < 3; i++) {
        double *c = C + 3 * i, c0 = c[0], c1 = c[1], c2 = c[2];
        c[0] = c0 * e00 + c1 * (xy + z) + c2 * (xz - y);
        c[1] = c0 * (xy - z) + c1 * e11 + c2 * (yz + x);
        c[2] = c0 * (xz + y) + c1 * (yz - x) + c2 * e22;
    }
    double ce = cos(earth), se = sin(earth);
    for (int j = 0; j < 3; j++) {
        double top = C[j], below = C[3 + j];
        C[j] = ce * top + se * below;
        C[3 + j] = ce * below - se * top;
    }
}

static void add_cross(const double a[3], const double b[3], double k, double *restrict out)
{
    out[0] += k * (a[1] * b[2] - a[2] * b[1]);
    out[1] += k * (a[2] * b[0] - a[0] * b[2]);
    out[2] += k * (a[0] * b[1] - a[1] * b[0]);
}

static void compensate(const double *x, const double *row, double phi[3], double dvs[3])
{
    double dth[3], dvl[3], dth0[3], dvl0[3], turned[3] = {0.0, 0.0, 0.0};  /* (M.12), (M.13) */
    for (int i = 0; i < 3; i++) {
        dth[i] = phi[i] = row[1 + i] - x[15 + i] * row[0];
        dvl[i] = dvs[i] = row[4 + i] - x[18 + i] * row[0];
        dth0[i] = x[34 + i] - x[15 + i] * x[33];
        dvl0[i] = x[37 + i] - x[18 + i] * x[33];
    }
    add_cross(dth0, dth, 1.0 / 12.0, phi);
    add_cross(dth, dvl, 0.5, turned);
    for (int i = 0; i < 3; i++)
        dvs[i] += turned[i];
    add_cross(dth, turned, 1.0 / 3.0, dvs);
    add_cross(dth0, dvl, 1.0 / 12.0, dvs);
    add_cross(dvl0, dth, 1.0 / 12.0, dvs);
}

static void mechanise(double *restrict x, const double *restrict row, double u[3], double C_mid[9])
{
    double dt = row[0], phi[3], dvs[3], g[3], r_mid[3], dv[3];  /* (M.14) */
    compensate(x, row, phi, dvs);
    for (int i = 0; i < 3; i++)
        u[i] = x[3 * i] * dvs[0] + x[3 * i + 1] * dvs[1] + x[3 * i + 2] * dvs[2];
    for (int i = 0; i < 9; i++)
        C_mid[i] = 0.5 * x[i];
    double half = 0.5 * dt * OMEGA_IE, u0 = u[0];
    u[0] += half * u[1];
    u[1] -= half * u0;
    for (int i = 0; i < 3; i++)
        r_mid[i] = x[12 + i] + 0.5 * dt * x[9 + i];
    gravity(r_mid, g);
    double vm0 = x[9] + 0.5 * (u[0] + g[0] * dt), vm1 = x[10] + 0.5 * (u[1] + g[1] * dt);
    dv[0] = u[0] + (g[0] + 2.0 * OMEGA_IE * vm1) * dt;
    dv[1] = u[1] + (g[1] - 2.0 * OMEGA_IE * vm0) * dt;
    dv[2] = u[2] + g[2] * dt;
    for (int i = 0; i < 3; i++) {
        double ds = dt * (x[9 + i] + 0.5 * dv[i]);
        x[9 + i] += dv[i];
        x[12 + i] += ds;
        x[21 + i] += ds;
    }
    rotate(x, phi, OMEGA_IE * dt);
    rotate(x + 24, phi, OMEGA_IE * dt);
    for (int i = 0; i < 9; i++)
        C_mid[i] += 0.5 * x[i];
}

static void gravity_gradient(const double r[3], double out[9])  /* (M.15) */
{
    double r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2], k = -9.81 / sqrt(r2);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = -3.0 * k * r[i] * r[j] / r2 + (i == j ? k : 0.0);
}

/* out = Phi M for the nine rows that Phi changes; M (15 rows at least, N), out (9, N), and of both
 * the first `columns` columns. (M.16) */
static inline void transition(const double (*restrict M)[N], int columns, double dt,
                              const double u[3], const double C[9], const double G[9],
                              double (*restrict out)[N])
{
    const double wd = OMEGA_IE * dt;
    for (int j = 0; j < columns; j++) {
        double p0 = M[0][j], p1 = M[1][j], p2 = M[2][j];
        double v0 = M[3][j], v1 = M[4][j], v2 = M[5][j];
        double r0 = M[6][j], r1 = M[7][j], r2 = M[8][j];
        double b0 = M[9][j], b1 = M[10][j], b2 = M[11][j];
        double a0 = M[12][j], a1 = M[13][j], a2 = M[14][j];
        double g0 = -dt * (C[0] * b0 + C[1] * b1 + C[2] * b2);
        double g1 = -dt * (C[3] * b0 + C[4] * b1 + C[5] * b2);
        double g2 = -dt * (C[6] * b0 + C[7] * b1 + C[8] * b2);
        out[0][j] = p0 + wd * p1 + g0;
        out[1][j] = p1 - wd * p0 + g1;
        out[2][j] = p2 + g2;
        double m0 = p0 + 0.5 * g0, m1 = p1 + 0.5 * g1, m2 = p2 + 0.5 * g2;
        double f0 = (u[2] * m1 - u[1] * m2) - dt * (C[0] * a0 + C[1] * a1 + C[2] * a2);
        double f1 = (u[0] * m2 - u[2] * m0) - dt * (C[3] * a0 + C[4] * a1 + C[5] * a2);
        double f2 = (u[1] * m0 - u[0] * m1) - dt * (C[6] * a0 + C[7] * a1 + C[8] * a2);
        f0 += dt * (G[0] * r0 + G[1] * r1 + G[2] * r2);
        f1 += dt * (G[3] * r0 + G[4] * r1 + G[5] * r2);
        f2 += dt * (G[6] * r0 + G[7] * r1 + G[8] * r2);
        out[3][j] = v0 + f0 + 2.0 * wd * v1;
        out[4][j] = v1 + f1 - 2.0 * wd * v0;
        out[5][j] = v2 + f2;
        out[6][j] = r0 + dt * (v0 + 0.5 * f0);
        out[7][j] = r1 + dt * (v1 + 0.5 * f1);
        out[8][j] = r2 + dt * (v2 + 0.5 * f2);
    }
}

static void predict(double (*restrict P)[N], double dt, double missing, const double u[3],
                    const double C_mid[9], const double r_e[3], const double q[4])
{
    double gradient[9], top[9][N], turned[15][N], square[9][N];  /* (M.16), (M.17) */
    gravity_gradient(r_e, gradient);
    transition((const double (*)[N])P, N, dt, u, C_mid, gradient, top);
    for (int i = 0; i < 9; i++)
        for (int j = 9; j < N; j++)
            P[i][j] = P[j][i] = top[i][j];
    for (int i = 0; i < 15; i++)
        for (int j = 0; j < 9; j++)
            turned[i][j] = top[j][i];
    transition((const double (*)[N])turned, 9, dt, u, C_mid, gradient, square);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j <= i; j++)
            P[i][j] = P[j][i] = 0.5 * (square[i][j] + square[j][i]);
    double blind = missing * missing * missing / 3.0, tilt = 0.0;
    double r2 = r_e[0] * r_e[0] + r_e[1] * r_e[1] + r_e[2] * r_e[2];
    for (int i = 0; i < 3; i++) {
        tilt += P[i][i];
        for (int j = 0; j < 3; j++)
            tilt -= r_e[i] * P[i][j] * r_e[j] / r2;
    }
    double bent = 0.25 * 9.81 * 9.81 * tilt * tilt * TILTED_S / r2 * dt;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            P[3 + i][3 + j] += bent * r_e[i] * r_e[j];
    for (int i = 0; i < 3; i++) {
        P[i][i] += q[0] * dt + GAP_TURN * blind;
        P[3 + i][3 + i] += q[1] * dt + GAP_FORCE * blind;
        P[9 + i][9 + i] += q[2] * dt;
        P[12 + i][12 + i] += q[3] * dt;
    }
}

/* Carry mean and covariance over `k` samples, noting displacement and attitude chain (k, 12). */
void run(double *x, double *P, const double *rows, long k, const double *q, double *track)
{
    double u[3], C_mid[9];
    for (; k > 0; k--, rows += 8, track += 12) {
        mechanise(x, rows, u, C_mid);
        predict((double (*)[N])P, rows[0], rows[7], u, C_mid, x + 12, q);
        memcpy(x + 33, rows, 7 * sizeof *x);
        memcpy(track, x + 21, 12 * sizeof *x);
    }
}
