"""Section 2 of the paper, place by place."""

from tests.paper.record import Record

RECORDS = (
    Record("(3)", 6, r"$q = 0$", "verified", "", ("test_3_q_vanishes",)),
    Record("(4)", 7, r"$I_3 = 0$", "verified", "", ("test_4_areas_vanish",)),
    Record(
        "(5)",
        8,
        r"$(A-C) p r - \gamma_3 V_1 + \gamma_1 V_3 = 0$",
        "verified",
        "",
        ("test_5_middle_equation",),
    ),
    Record(
        "(6), the squares",
        9,
        r"$p^2 = \frac{C \gamma_3}{A (A-C) \gamma_1} D$, $r^2 = \frac{A \gamma_1}{C (A-C) \gamma_3} D$",
        "verified",
        "",
        ("test_6_squares_of_the_angular_velocities",),
    ),
    Record(
        "(6), the signs",
        9,
        r"$p = -\sqrt{\ldots}$, $r = +\sqrt{\ldots}$",
        "erratum",
        r"$p = -C \gamma_3 s$, $r = A \gamma_1 s$ with one $s$ of either sign, "
        r"$s^2 = \frac{D}{(A-C) A C \gamma_1 \gamma_3}$; $s$ changes its sign at a rest point. "
        r"$V = \gamma_1$, $A = 2C = 2$ at $(\gamma_1, \gamma_3) = (-\frac14, \frac12)$: "
        r"printed $I_3 = \frac{1}{\sqrt2}$.",
        ("test_6_signs_of_the_angular_velocities", "test_6_one_amplitude"),
    ),
    Record(
        "(e)",
        10,
        r"$L(V) = \gamma_1\gamma_2\gamma_3 (A V_{11} - C V_{33}) "
        r"+ (A\gamma_1^2 + C\gamma_3^2)(\gamma_1 V_{23} - \gamma_3 V_{12}) "
        r"- \gamma_2 (A\gamma_1^2 - C\gamma_3^2) V_{13} - (A-2C) \gamma_2\gamma_3 V_1 "
        r"+ 2(A-C) \gamma_3\gamma_1 V_2 - (2A-C) \gamma_1\gamma_2 V_3 = 0$",
        "verified",
        r"with (6), the left sides of (1) less the right ones are $\frac{L}{2(A-C)\gamma_1}$, 0, "
        r"$-\frac{L}{2(A-C)\gamma_3}$.",
        ("test_e_the_operator_of_the_service", "test_e_is_what_the_first_and_third_equations_say"),
    ),
    Record(
        "(7)",
        11,
        r"$\frac{d\gamma_3}{d\gamma_1} = \frac{C \gamma_3}{A \gamma_1}$",
        "verified",
        "",
        ("test_7_slope_of_the_curve",),
    ),
    Record(
        "(8)",
        12,
        r"$\gamma_3 = \lambda \gamma_1^{C/A}$",
        "erratum",
        r"$\lvert\gamma_3\rvert = \lambda \lvert\gamma_1\rvert^{C/A}$: $\gamma_1 \lt 0$ is as good, "
        r"and on a motion through the poles $\gamma_3$ takes both signs at one $\lambda$.",
        ("test_8_curve", "test_8_both_signs_belong_to_it"),
    ),
    Record(
        "(9)",
        13,
        r"$\gamma_2 = +\sqrt{1 - \gamma_1^2 - \lambda^2 \gamma_1^{2C/A}}$",
        "erratum",
        r"$\pm$: on a motion that reaches the equator $\gamma_2 = 0$ the sign changes.",
        ("test_9_second_component", "test_9_both_signs_belong_to_it"),
    ),
    Record(
        "(t)",
        14,
        r"$t = \int \frac{d\gamma_1}{\sqrt{g(\gamma_1)}}$",
        "verified",
        r"with the sign of $\gamma_2$ in $g$, see the last term of $\varpi$",
        ("test_t_quadrature",),
    ),
    Record(
        r"$g(\gamma_1)$, display after (t)",
        None,
        r"$g = \frac{A \gamma_1^{(A-C)/A}}{C (A-C) \lambda} "
        r"(1 - \gamma_1^2 - \lambda^2 \gamma_1^{2C/A}) (D)_0$",
        "verified",
        r"for $\gamma_1, \gamma_3 \gt 0$; $\lvert\gamma_1\rvert$ and the sign of $\gamma_1 \gamma_3$ else",
        ("test_g_of_the_quadrature",),
    ),
    Record(
        "Theorem 1",
        None,
        "for an arbitrary body and $V$ with (e) the equations are solved by (6), (8), (9), (t)",
        "erratum",
        r"needs $A \ne C$, and $\frac{D}{(A-C)\gamma_1\gamma_3} \ge 0$ somewhere on the curve: with $A = 2C$ "
        r"and $V = \gamma_1$ there is no motion at $\gamma_1 \gt 0$. Also (e) on one curve is enough for the "
        r"motions on it: $V = -\gamma_1 + (\gamma_3^2 - \gamma_1)^2$ at $\lambda = 1$.",
        (
            "test_theorem_1_two_routes",
            "test_theorem_1_for_an_arbitrary_body",
            "test_theorem_1_needs_less",
        ),
    ),
)
