"""Section 5 of the paper, place by place."""

from tests.paper.record import Record

RECORDS = (
    Record(
        "(e1)",
        30,
        r"(e) for $V(\gamma_1, \gamma_3)$ without its factor $\gamma_2$",
        "verified",
        "",
        ("test_e1_equation_without_g2",),
    ),
    Record(
        "(v)",
        31,
        r"$V = \sum a_\nu \gamma_1^\nu g_\nu(v)$, $v = 1 + \frac{\gamma_3^2}{\gamma_1^2}$",
        "verified",
        r"(e1) becomes $-4(A-C) \gamma_1^{\nu-1} \gamma_3$ times (eg), corrected",
        ("test_v_and_eg_corrected",),
    ),
    Record(
        "(eg)",
        32,
        r"last term $(\frac{\alpha\nu}{\alpha-1} - 2) g_\nu$",
        "erratum",
        r"$-\frac\nu4 (\frac{\alpha\nu}{\alpha-1} - 2) g_\nu$. For $\alpha = 2$, $\nu = 3$ and the "
        r"polynomial (g1) the printed left side is $7 g_\nu$.",
        ("test_eg_printed",),
    ),
    Record(
        "(g1)",
        33,
        r"$g_{\nu1} = F(-\frac\nu2, 1 - \frac{\alpha\nu}{2(\alpha-1)}; 2 - \frac\nu2; v)$",
        "verified",
        "of (eg), corrected",
        ("test_g1_parameters",),
    ),
    Record(
        "(g1), (t1) where the series does not end",
        33,
        r"$F(a, b; c; v)$ at $v \gt 1$",
        "erratum",
        r"the series diverges and $v \gt 1$ is the cut of $F$: the value is complex. A real solution is "
        r"$F(a, b; a+b+1-c; 1-v)$.",
        ("test_g1_is_complex",),
    ),
    Record(
        "(g2)",
        34,
        r"$g_{\nu2} = v^{\nu/2-1} F(-1, -\frac{\nu}{2(\alpha-1)}; \frac\nu2; v) "
        r"= v^{\nu/2-1} \frac{\alpha-1+v}{\alpha-1}$",
        "verified",
        "of (eg), corrected",
        ("test_g2_second_solution",),
    ),
    Record(
        "display after (g2)",
        35,
        r"$A_\nu (\gamma_1^2+\gamma_3^2)^{\nu/2-1} (\alpha\gamma_1^2 + \gamma_3^2)$, of the form (V2)",
        "verified",
        "",
        ("test_contribution_of_g2",),
    ),
    Record(
        "(t1)",
        36,
        r"$\gamma_1^\nu F(-\frac\nu2, 1 - \frac{\alpha\nu}{2(\alpha-1)}; 2 - \frac\nu2; v)$",
        "verified",
        r"where the series ends; $n \le 3$ against the service",
        ("test_t1_is_the_term_of_the_service",),
    ),
    Record(
        "transformation, display after (t1)",
        None,
        r"$F(a,b;c;v) = (1-v)^{c-a-b} F(c-a,c-b,c)$",
        "erratum",
        "$F(c-a, c-b; c; v)$ on the right",
        ("test_transformation",),
    ),
    Record(
        "transformation of (t1), next display",
        None,
        r"$F(\ldots) = (1-v)^{1+\frac{\alpha\nu}{2(\alpha-1)}} "
        r"F(2, 1 + \frac{\nu}{2(\alpha-1)}; 2 - \frac\nu2; v)$",
        "remark",
        r"exponent and parameters are right; $1 - v \lt 0$ here, so that a real solution has $(v-1)$ "
        r"for $(1-v)$",
        ("test_transformation_applied",),
    ),
    Record(
        "case 1)",
        None,
        r"$a$ a negative integer: only $\nu = 2$, of the form (V2)",
        "verified",
        "",
        ("test_case_1",),
    ),
    Record(
        "case 2)",
        None,
        r"$b = -n$ gives $c = \alpha+1+(\alpha-1)n$ and (t2)",
        "erratum",
        r"it gives $\nu = \frac{2(\alpha-1)(n+1)}{\alpha}$ as printed, $c = 1-n+\frac{n+1}{\alpha}$ and "
        r"(t3). $\alpha = 2$, $n = 0$: $\nu = 1$, (t2) is $\gamma_3^{-2}$ and (t3) is $\gamma_1$.",
        ("test_case_2_is_t3",),
    ),
    Record(
        "case 3)",
        None,
        r"$c-b = -n$ gives (t3)",
        "erratum",
        r"it gives $\nu = -2(\alpha-1)(n+1)$ as printed, $c = \alpha+1+(\alpha-1)n$ and (t2)",
        ("test_case_3_is_t2",),
    ),
    Record(
        "cases 1), 2), the condition on $c$",
        None,
        "not a negative integer greater than $-n$",
        "erratum",
        r"nor zero: $n = 2$, $\alpha = 3$ has $c = 0$ in (t3)",
        ("test_exclusion_of_zero",),
    ),
    Record(
        "case 3), the exceptions",
        None,
        r"$\alpha \ne \frac{n+1}{n-1-k}$, $k = 0, \ldots, n$",
        "erratum",
        r"they belong to (t3), for $k = 0, \ldots, n-2$ ($k = n-1$ divides by zero, $k = n$ gives "
        r"$\alpha \lt 0$); and at $\alpha = \frac{n+1}{n}$ the term (t3) is a multiple of $Q$, nothing new",
        ("test_exclusions",),
    ),
    Record(
        "(t2)",
        37,
        r"$\frac{\gamma_1^{2n}}{\gamma_3^{2(\alpha n+\alpha-1)}} F(2, -n; \alpha+1+(\alpha-1)n; v)$",
        "verified",
        r"numerator homogeneous of degree $2n$",
        ("test_t2_solves_the_equation",),
    ),
    Record(
        "(t2), its power",
        37,
        r"$2(\alpha n+\alpha-1)$ always positive, undefined at $\gamma_3 = 0$ for all $n$",
        "erratum",
        r"not for $\alpha \lt \frac1{n+1}$: $\alpha = \frac12$, $n = 0$ is $V = \gamma_3$. For "
        r"$\alpha \lt 1$ there are exceptions as well: no term at $\alpha = \frac13$, $n = 2$ ($c = 0$), a "
        r"multiple of $Q$ at $\alpha = \frac12$, $n = 1$.",
        ("test_t2_power",),
    ),
    Record(
        "(t3)",
        38,
        r"$\gamma_1^{\frac{2(\alpha-1-n)}{\alpha}} \gamma_1^{2n} F(-n, -\frac{\alpha-1}{\alpha}(n+1); "
        r"1-n+\frac{n+1}{\alpha}; v)$",
        "verified",
        "",
        ("test_t3_solves_the_equation",),
    ),
    Record(
        "final potential, last display",
        None,
        r"$V = Q \sum A_n\gamma_2^n + \sum B_n (\ldots) + \sum C_n (\ldots)$",
        "verified",
        r"where its terms are defined and for $\gamma_1, \gamma_3 \gt 0$; else $\lvert\gamma_1\rvert$, "
        r"$\lvert\gamma_3\rvert$ under the powers",
        ("test_final_potential",),
    ),
)
