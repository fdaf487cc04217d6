"""Section 3 of the paper, place by place."""

from tests.paper.record import Record

RECORDS = (
    Record(
        "(V)",
        15,
        r"general solution $V = V_1 + V_2$",
        "verified",
        r"$(\gamma_1\partial_3 - \gamma_3\partial_1) \frac{V}{Q} = \frac{2(A-C)\gamma_1\gamma_3}{Q^2} H[V]$",
        ("test_V_general_solution", "test_V_of_the_service"),
    ),
    Record(
        "(V1), that it solves (e)",
        16,
        r"$V_1 = Q \int^Q F(\ldots) \frac{du}{u^2}$",
        "verified",
        r"$H[V_1] = -F$",
        ("test_V1_solves_the_equation", "test_V1_integral"),
    ),
    Record(
        "(V1), argument of $F$",
        16,
        r"$\frac{[A(\gamma_1^2+\gamma_3^2)-u]^{A/C}}{C(\gamma_1^2+\gamma_3^2)-u}$",
        "erratum",
        r"negative for $A \gt C$, complex for $A \lt C$. Real for both: "
        r"$\frac{\lvert A\rho-u\rvert^{A/C}}{\lvert C\rho-u\rvert}$, at $u = Q$ equal to $w \gt 0$, with "
        r"$F(w)$ for the printed $F(-w)$.",
        ("test_V1_argument",),
    ),
    Record(
        "(V1), one $F$",
        16,
        "one function $F$",
        "erratum",
        r"one for every quadrant of $(\gamma_1, \gamma_3)$. With one, $V_1$ is even in $\gamma_1$ and "
        r"$\gamma_3$; $V = a\gamma_1$, $A = 2C$ has $H = -\frac12 a\nu$, odd, at equal $w$.",
        ("test_V1_needs_a_function_per_quadrant",),
    ),
    Record(
        "(V1), lower limit",
        16,
        "none",
        "erratum",
        r"a multiple of $\rho$; which one is a matter of $G$. A fixed number leaves the interval between "
        r"$C\rho$ and $A\rho$: $F = \frac1w$, $A = 2C = 2$, limit $\frac32$ crosses a pole at "
        r"$\rho = \frac12$.",
        ("test_V1_lower_limit",),
    ),
    Record(
        "(V2)", 17, r"$V_2 = Q G(\gamma_2)$", "verified", r"$H[V_2] = 0$", ("test_V2_solves_the_equation",)
    ),
    Record(
        "(O)",
        18,
        r"$(p, q, r) = (-\sqrt{\frac{2C}{A}} \gamma_3, 0, \sqrt{\frac{2A}{C}} \gamma_1) \sqrt{\varpi}$",
        "erratum",
        r"$\pm\sqrt{-\varpi}$, as (T) has it. $V = -\gamma_1$, $A = 2C = 2$, $\nu = 1$ at "
        r"$\gamma_1 = \frac12$: $\varpi = -1$ and $p^2 = \frac12$.",
        ("test_O_angular_velocities", "test_O_on_motions"),
    ),
    Record(
        r"$\varpi$, display after (O)",
        19,
        r"$\varpi = \frac{F}{Q} + \int^Q F \frac{du}{u^2} + G$",
        "verified",
        "the three terms; for the argument of $F$ see (V1)",
        ("test_varpi_by_its_integral",),
    ),
    Record(
        r"$\varpi$, last term",
        19,
        r"$G(+\sqrt{1 - \gamma_1^2 - \lambda^2\gamma_1^{2C/A}})$",
        "erratum",
        r"$G(\gamma_2)$ with its sign. $V = Q\gamma_2$, $A = 2C = 2$ at $\frac17 (2, -6, 3)$: "
        r"$s^2 = \frac67$, printed $-\frac67$.",
        ("test_varpi_sign_of_g2",),
    ),
    Record(
        "(T)",
        20,
        r"$g = -\frac{2A\gamma_1^2}{C} (1 - \gamma_1^2 - \lambda^2\gamma_1^{2C/A}) \varpi$",
        "verified",
        "",
        ("test_T_integrand", "test_T_quadrature"),
    ),
    Record(
        "$h$, display after (T)",
        21,
        r"$h = -F(-\lambda^{2A/C} (A-C)^{A/C-1})$",
        "verified",
        r"for $A \gt C$; $-F(w_0)$, $w_0 = \lvert A-C\rvert^{A/C-1} \lambda^{2A/C}$ for both",
        ("test_h_is_kept", "test_h_depends_on_the_curve_by_its_argument"),
    ),
)
