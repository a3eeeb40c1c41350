"""Numbers of the source, typed a second time from its tables, apart from ``printed.toml``.

Both are compared, so a wrong digit in either is found. Units are those of the source.
"""

BOBBERT_1990 = "bobbert_van_ingen_schenau_1990"

SCALES = {  # l0 [mm], F0 [N]
    "rat": (27.0, 0.29),
    "frog": (31.0, 0.67),
    "cat": (31.9, 0.18),
    "human": (215.9, 193.1),
    "woittiez_1984": (60.0, 3000.0),
    BOBBERT_1990: (61.0, 2430.0),
}
TABLE_2_1 = {  # k1, k2, from, to, r2
    "frog": (0.0006, 20.63, 0.94, 1.39, 0.95),
    "cat": (0.0301, 9.16, 1.00, 1.40, 0.95),
    "human": (0.0037, 10.43, 1.05, 1.29, 0.89),
    "woittiez_1984": (0.0787, 7.93, None, None, 0.99),
    BOBBERT_1990: (0.00001, 24.59, None, None, 0.99),
}
TABLE_2_2 = {"rat": (0.027, 0.079, 0.98), "frog": (0.014, 0.049, 0.99), "cat": (0.028, 0.083, 0.98)}  # k3, k4, r2
TABLE_2_3 = {  # k5, k6, k7, from, to
    "rat": (-4.50, 8.95, -3.45, 0.7, 1.2),
    "frog": (-6.79, 14.69, -6.88, 0.68, 1.34),
    "cat": (-5.71, 11.52, -4.81, 0.73, 1.35),
    "human": (-13.43, 28.23, -13.96, 0.82, 1.28),
    "woittiez_1984": (-6.25, 12.50, -5.25, None, None),
    "bobbert_1986": (-6.25, 12.50, -5.25, None, None),
}
TABLE_2_3_FIT = {"frog": 0.96, "cat": 0.99, "human": 0.75}
TABLE_2_4 = {  # a/F0, F0 [N], b/Vmax, Vmax [mm/s]
    "rat": (0.356, 4.30, 0.38, 144.0),
    "frog": (0.27, 0.67, 0.28, 42.0),
    "cat": (0.27, 0.18, 0.30, 191.0),
    "human": (0.81, 200.0, 0.81, 1115.0),
    "woittiez_1984": (0.224, None, 0.224, None),
    "bobbert_1986": (0.41, 3000.0, 0.39, 756.0),
    BOBBERT_1990: (0.41, 2430.0, 0.41, 780.0),
    "hof_van_den_berg_1981": (0.12, None, 0.12, None),
}
ENVELOPE = {"k5": (-13.5, -4.5), "k6": (9.0, 28.2), "k7": (-14.0, -3.45), "a": (0.12, 0.41), "b": (0.12, 0.41)}
TABLE_3_1 = {  # N, L0, B, R0, t0 [mm], m [N/bar], b [N]
    "1-1-4": (1.5, 264.0, 277.1, 8.7, 2.4, 56.9, 109.8),
    "3-4": (1.5, 181.0, 190.6, 6.4, 1.6, 28.0, -38.2),
    "1-2": (1.7, 126.0, 130.5, 3.2, 1.2, 3.6, 28.3),
}
OTHERS = {
    "table-2.2.max-elongation": 8.0,
    "table-2.2.with-tendon": 0.8,
    "fig-2.6.hatze": 1.3,
    "fig-2.6.hof_van_den_berg_1981a": 1.2,
    "fig-2.6.lehman": 1.8,
    "eq-2.5.saturation": 1.3,
    "fig-2.8.k5": -6.9,
    "fig-2.8.k6": 13.8,
    "fig-2.8.k7": -5.9,
    "fig-2.8.a": 0.28,
    "fig-2.8.b": 0.28,
    "table-3.1.c10": 118.4,
    "table-3.1.c01": 105.7,
    "fig-3.3.ratio": 4000.0,
    "fig-3.3.highest": 5.0,
    "fig-3.4.geometric": 500.0,
    "fig-3.4.bladder": 250.0,
    "fig-3.4.difference": 500.0 - 250.0,
    "fig-3.7.rest": 180.0,
    "fig-3.7.concentric": 300.0,
    "fig-3.7.eccentric": 150.0,
    "fig-3.7.ripple-500": 15.0,
    "fig-3.7.ripple-300": 9.0,
    "fig-3.7.ripple-200": 6.0,
    "fig-3.8.concentric": 300.0,
    "fig-3.8.eccentric": 300.0,
    "fig-3.8.rest": 250.0,
    "fig-3.8.twice": 2.0,
    "fig-3.9.slow": 734.0,
    "fig-3.9.fast": 690.0,
    "fig-3.9.loss": -6.0,
    "eq-4.density": 900.0,
    "eq-4.ideal": 1.0,
    "eq-4.real": 0.61,
}


def collect_numbers() -> dict[str, float]:
    """Return every number by item identifier."""
    numbers: dict[str, float | None] = dict(OTHERS)
    for prefix, table, keys in (
        ("scales", SCALES, ("l0", "f0")),
        ("table-2.1", TABLE_2_1, ("k1", "k2", "from", "to", "r2")),
        ("table-2.2", TABLE_2_2, ("k3", "k4", "r2")),
        ("table-2.3", TABLE_2_3, ("k5", "k6", "k7", "from", "to")),
        ("table-2.4", TABLE_2_4, ("a", "f0", "b", "vmax")),
        ("eq-2.5", ENVELOPE, ("low", "high")),
        ("table-3.1", TABLE_3_1, ("turns", "l0", "braid", "r0", "t0", "m", "b")),
    ):
        for name, row in table.items():
            numbers |= {f"{prefix}.{name}.{key}": value for key, value in zip(keys, row, strict=True)}
    numbers |= {f"table-3.1.{size}.radius": row[3] for size, row in TABLE_3_1.items()}
    numbers |= {f"table-2.3.{name}.fit": value for name, value in TABLE_2_3_FIT.items()}
    numbers |= {f"table-2.3.{name}.at-rest": 1.0 for name in TABLE_2_3}  # the definition of F0 and l0
    numbers |= {f"table-2.4.{name}.at-vmax": 0.0 for name in TABLE_2_4}  # the definition of Vmax
    return {name: value for name, value in numbers.items() if value is not None}
