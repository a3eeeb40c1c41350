"""Change of the Bayesian information criterion in words."""


def format_bic_drop(drop: float, decimals: int = 0) -> str:
    """Return in words how BIC changes if it falls by ``drop``: 'falls by 12', 'rises by 3' or 'does not change'."""
    if round(drop, decimals) == 0.0:
        return "does not change"
    return f"falls by {drop:.{decimals}f}" if drop > 0.0 else f"rises by {-drop:.{decimals}f}"
