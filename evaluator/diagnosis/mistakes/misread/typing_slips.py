"""Numbers of which a written one is what a slip of the keyboard leaves: a digit left out or doubled, two exchanged."""

from __future__ import annotations

DIGITS = "0123456789"
DECIMALS = 6  # more are rounding in a file: 3.3999999999999986 was 3.4 to whoever wrote it


def before_a_slip(value: float) -> dict[float, str]:
    """The numbers that may have been meant by a written one, with the same sign, and what to check for each.

    Digits after the decimal point change too little to be noticed, and a 0 is a motor that is off.
    """
    whole, _, rest = f"{abs(value):.{DECIMALS}f}".partition(".")
    if not value:
        return {}
    lacks = {whole[:k] + digit + whole[k:]: "for a digit left out" for k in range(len(whole) + 1) for digit in DIGITS}
    doubled = {
        whole[:k] + whole[k + 1 :]: "for a digit typed twice" for k in range(1, len(whole)) if whole[k] == whole[k - 1]
    }
    swapped = {
        whole[:k] + whole[k + 1] + whole[k] + whole[k + 2 :]: "for two digits exchanged" for k in range(len(whole) - 1)
    }
    sign = -1.0 if value < 0 else 1.0
    meant = {sign * float(f"{digits}.{rest}"): what for digits, what in (lacks | doubled | swapped).items()}
    return {number: what for number, what in meant.items() if number != sign * float(f"{whole}.{rest}")}
