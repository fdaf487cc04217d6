"""Section 4 of the paper, place by place."""

from tests.paper.record import Record

RECORDS = (
    Record(
        "text before $F(u)$",
        None,
        r"$u^{n+1/2}$ and $u^{-n}$ lead to rational potentials",
        "verified",
        r"the first for $n \ge 0$, the second for $n \ge 1$; six of each",
        ("test_F_powers_lead_to_rational_potentials",),
    ),
    Record(
        "$F(u)$",
        22,
        r"$\sqrt u (A_1 + A_2 u + a_3 u^2) + \frac{B_1}{u} + \frac{B_2}{u^2} + \frac{B_3}{u^3}$",
        "erratum",
        r"$A_3$ for $a_3$. Since $u = -C\nu^2 \lt 0$, a real $V$ has imaginary $A_n$; "
        r"$B_1 = -2Cb_1$, $B_2 = 6C^2 b_2$, $B_3 = -20C^3 b_3$.",
        ("test_F_of_the_rational_potentials",),
    ),
    Record(
        "$V_1$, display after $F(u)$",
        23,
        r"$a_1\gamma_1 + a_2 [8\gamma_1(\gamma_1^2+\gamma_3^2) + \frac{\gamma_3^4}{\gamma_1}] + a_3 [\ldots] "
        r"+ \frac{b_1}{\gamma_3^2} + b_2 \frac{\gamma_1^2-\gamma_3^2}{\gamma_3^6} "
        r"+ b_3 \frac{2\gamma_1^4-2\gamma_1^2\gamma_3^2+\gamma_3^4}{\gamma_3^{10}}$",
        "verified",
        "all terms but that of $a_3$",
        ("test_V1_rational_terms",),
    ),
    Record(
        "$V_1$, term of $a_3$",
        23,
        r"$16\gamma_1(8\gamma_1^4 + 16\gamma_1^2\gamma_3^2 + 9\gamma_3^4) + \frac{16\gamma_3^6}{\gamma_1} "
        r"+ \frac{\gamma_3^8}{\gamma_1^3}$",
        "erratum",
        r"$- \frac{\gamma_3^8}{\gamma_1^3}$. As printed "
        r"$L(V) = -64 C \gamma_2 \frac{\gamma_3^7}{\gamma_1^2} \ne 0$.",
        ("test_V1_rational_a3",),
    ),
    Record(
        "(Vr)",
        24,
        r"$V = V_1 + c_1(\gamma_1^2 - \gamma_2^2) + c_2\gamma_2^2(2\gamma_1^2 + \gamma_3^2)$",
        "verified",
        r"up to a constant; $c_i = C C_i$",
        ("test_Vr_full_potential",),
    ),
    Record(
        "$t$ before (Vg)",
        25,
        r"$t = \lambda^2 \sqrt{\frac C2} \int \frac{dx}{\sqrt{g(x)}}$",
        "erratum",
        r"$\nu$ for $\lambda$ everywhere, $\nu = \frac{\gamma_3^2}{\gamma_1} = \lambda^2$ of (8). "
        r"$V = -\gamma_1$, $C = 1$, $\lambda = 2$ at $x = \frac18$: $\dot x^2 = \frac{31}{256}$, "
        r"printed $\frac{47}{256}$.",
        ("test_t_and_g_lambda", "test_t_of_the_hyperelliptic_integral"),
    ),
    Record(
        "$g(x)$ before (Vg), its terms",
        26,
        r"$\frac1x (1 - x^2 - \lambda x) "
        r"(\lambda^4 [2c_2x^5 - \ldots] - 2(b_1\lambda^2 + 3b_2)x + 2b_2\lambda)$",
        "verified",
        r"term by term, $\lambda$ read as $\nu$",
        ("test_g_terms_as_printed",),
    ),
    Record(
        "$g(x)$ before (Vg), what it leaves out",
        26,
        "$a_3$ and $b_3$ of $V_1$ do not occur",
        "erratum",
        r"add $(1 - x^2 - \nu x)$ times $-a_3\nu^4 x (128x^4 + 192\nu x^3 + 48\nu^2x^2 - 8\nu^3x + 3\nu^4) "
        r"- \frac{2b_3}{\nu^2x^2} (10x^2 - 4\nu x + \nu^2)$",
        ("test_g_terms_left_out",),
    ),
    Record(
        "text after $g(x)$",
        None,
        "ultraelliptic when $c_2 = 0$, elliptic if moreover $a_2 = b_2 = 0$",
        "erratum",
        r"$c_2 = 0$ leaves genus 3. Genus 2 (ultraelliptic) needs $b_2 = 0$ or $a_2 = c_2 = 0$; "
        r"elliptic as printed.",
        ("test_genus",),
    ),
    Record(
        "(Vg)",
        27,
        r"$V = a_1\gamma_1 + c_1(\gamma_1^2 - \gamma_2^2) + \frac{b_1}{\gamma_3^2}$",
        "verified",
        r"$h = -\frac12 a_1\nu - \frac{2b_1}{\nu^2} - c_1$",
        ("test_Vg_three_terms",),
    ),
    Record(
        r"$\gamma_3, \gamma_2, p, q, r$, display before (tg)",
        28,
        r"$\gamma_3 = \sqrt{\nu\gamma_1}$, $\gamma_2 = \sqrt{1 - \nu x - x^2}$, $p = -\sqrt{\ldots}$, "
        r"$r = \frac1\nu\sqrt{\ldots}$",
        "erratum",
        r"the squares are right, $x$ in $\gamma_2$ is $\gamma_1$; all four roots change their signs "
        r"on motions: $p$, $r$ at rest points, $\gamma_2$ at the equator, $\gamma_3$ at the poles.",
        ("test_solution_of_Vg", "test_solution_of_Vg_signs"),
    ),
    Record(
        "(tg)",
        29,
        r"$t = \sqrt{\frac C2} \nu "
        r"\int \frac{dx}{\sqrt{(x^2 + \nu x - 1)(2b_1 + \nu^2a_1x + 2\nu^2c_1x^2)}}$",
        "verified",
        "inverted by elliptic functions",
        (
            "test_tg_elliptic_integral",
            "test_tg_elliptic_integral_of_the_service",
            "test_tg_inverted",
        ),
    ),
    Record(
        "text after (tg)",
        None,
        "the solution does not depend on $B$",
        "verified",
        "",
        ("test_B_remains_arbitrary",),
    ),
    Record(
        "list after (tg)",
        None,
        r"$A = B = 2C$: integrable, for $b_1 = c_1 = 0$ at any $I_3$; $b_1 = 0$ is a body moving by inertia "
        "in a fluid",
        "remark",
        r"the integrals of degree 4 exist. Kirchhoff's equations at constant impulse have a quadratic $V$; "
        r"the linear term $a_1\gamma_1$ belongs to them only with a circulation through holes of the body, "
        r"else $a_1 = 0$ as well. (Literature; not computed.)",
        ("test_integrable_neighbours",),
    ),
)
