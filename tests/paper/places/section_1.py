"""Section 1 of the paper, place by place."""

from tests.paper.record import Record

RECORDS = (
    Record(
        "Table 1, case 1 (Hess)",
        None,
        "solvable",
        "verified",
        r"$b = 0$, $A a^2 (B-C) = C c^2 (A-B)$, $A a p + C c r = 0$",
        ("test_table_1_hess",),
    ),
    Record(
        "Table 1, case 2 (Staude)",
        None,
        "solvable",
        "verified",
        r"$\omega = w \gamma$ constant, on a cone of $\gamma$",
        ("test_table_1_staude",),
    ),
    Record(
        "Table 1, case 3 (Bobylev-Steklov)",
        None,
        "solvable",
        "remark",
        r"$b = c = 0$, $A = 2C$; $q = 0$, $p$ constant, $a \gamma_3 = C p r$ for every energy $h$. "
        r"The motions of the paper, $I_3 = 0$, are those with $h = C p^2$.",
        ("test_table_1_bobylev_steklov",),
    ),
    Record(
        "Table 1, case 4 (Goriachev)",
        None,
        "solvable",
        "verified",
        r"$b = c = 0$, $A C = 8 (A-2B)(B-C)$, $I_3 = 0$; at one body",
        ("test_table_1_goriachev",),
    ),
    Record(
        "Table 1, case 5 (Steklov)",
        None,
        "solvable",
        "verified",
        r"$b = c = 0$, $I_3 = 0$; $q^2$, $r^2$ quadratic in $p$; at one body",
        ("test_table_1_steklov",),
    ),
    Record(
        "Table 1, case 6 (Chaplygin)",
        None,
        "solvable",
        "verified",
        r"$b = c = 0$, $9A^2 - 18A(B+C) + 32BC = 0$, $h = I_3 = 0$; at one body",
        ("test_table_1_chaplygin",),
    ),
    Record(
        "Table 1, case 7 (N. Kowalewski)",
        None,
        "solvable",
        "verified",
        r"$b = c = 0$, $A C = 9 (A-2B)(B-C)$; at one body",
        ("test_table_1_kowalewski",),
    ),
    Record(
        "Table 1, case 8 (Grioli)",
        None,
        "solvable",
        "verified",
        r"$b = 0$, $a^2 (B-C) = c^2 (A-B)$; regular precession; at one body",
        ("test_table_1_grioli",),
    ),
    Record(
        "Table 1, case 9 (Dokshevich 1965)",
        None,
        "solvable",
        "remark",
        "the bodies of case 1, momentum along the centre not zero; at one body. The name is attached by the "
        "form of the solution.",
        ("test_table_1_dokshevich",),
    ),
    Record(
        "Table 1, case 10 (Konosevich-Pozdnyakovich)",
        None,
        "solvable",
        "remark",
        r"$b = c = 0$, two bodies with moments of degree 7 over the rationals; $p = p_0 + s^2$, $q^2$ and "
        r"$r^2$ of degree 4 in $s$. The name is attached by the form of the solution. Case 11 (Dokshevich "
        "1970) is not proved here.",
        (
            "test_table_1_konosevich_pozdnyakovich",
            "test_table_1_konosevich_pozdnyakovich_is_real",
        ),
    ),
    Record(
        "(1)",
        1,
        r"$A \dot p + (C-B) q r = \gamma_2 V_3 - \gamma_3 V_2$, and cyclically",
        "verified",
        "",
        ("test_1_euler",),
    ),
    Record(
        "(2)",
        2,
        r"$\dot\gamma_1 + q \gamma_3 - r \gamma_2 = 0$, and cyclically",
        "verified",
        "",
        ("test_2_poisson",),
    ),
    Record(
        "text after (2)",
        None,
        r"$V = a \gamma_1 + b \gamma_2 + c \gamma_3$",
        "verified",
        "",
        ("test_classical_potential",),
    ),
    Record(
        "(E)", 3, r"$I_1 = \frac12 (A p^2 + B q^2 + C r^2) + V$ constant", "verified", "", ("test_E_energy",)
    ),
    Record(
        "(g)",
        4,
        r"$I_2 = \gamma_1^2 + \gamma_2^2 + \gamma_3^2 = 1$ constant",
        "verified",
        "",
        ("test_g_geometric",),
    ),
    Record(
        "(a)",
        5,
        r"$I_3 = A p \gamma_1 + B q \gamma_2 + C r \gamma_3$ constant",
        "verified",
        "",
        ("test_a_areas",),
    ),
)
