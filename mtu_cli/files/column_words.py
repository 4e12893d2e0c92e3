"""What measuring programs call the columns of points and of readings, in a few languages."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

WORDS = {
    "part": ("part", "workpiece", "piece", "serial", "werkstuck", "werkstueck", "teil", "bauteil",
             "teilenummer", "seriennummer", "pieza", "pezzo"),
    "feature": ("feature", "hole", "bore", "characteristic", "element", "merkmal", "bohrung",
                "loch", "punkt", "caracteristique", "alesage", "trou", "caracteristica", "agujero",
                "taladro", "foro"),
    "repeat": ("repeat", "repetition", "wiederholung", "repeticion"),
    "component": ("component", "komponente", "composante", "componente"),
    "error": ("error", "err", "deviation", "dev", "abweichung", "abw", "fehler", "messabweichung",
              "erreur", "ecart", "desviacion", "errore", "scostamento"),
    "unit": ("unit", "units", "einheit", "masseinheit", "unite", "unidad", "unita"),
    "position_mm": ("position", "pos", "messposition", "posicion", "posizione"),
}  # fmt: skip
ACTUAL = ("actual", "act", "measured", "meas", "measurement", "ist", "istmass", "istwert",
          "gemessen", "messwert", "mesure", "mesuree", "medido", "medida", "real",
          "misurato")  # fmt: skip
NOMINAL = ("nominal", "nom", "soll", "sollmass", "sollwert", "nennmass", "nennwert", "theorique",
           "nominale", "teorico")  # fmt: skip
"""Without accents and in lower case; `x`, `y` or `z` stands before or behind."""
NUMBER = {"no", "nr", "n", "number", "id", "num", "numero"}
UNIT = "mm"
AXES = ("x", "y", "z")


def by_common_word(name: str, others: Iterable[str]) -> str | None:
    """The first of other columns that common words say is the column `name`."""
    return next((other for other in others if meant_by(other) == name), None)


def meant_by(other: str) -> str | None:
    """The column that common words mean: `part` by `Werkstück-Nr.`, `nominal_x_mm` by
    `Nennmaß X [mm]`.
    """
    plain = unicodedata.normalize("NFKD", other.casefold())
    plain = "".join(sign for sign in plain if not unicodedata.combining(sign))
    words = [word for word in re.findall("[a-z]+", plain) if word != UNIT]
    axes = [word for word in words if word in AXES]
    if len(axes) == 1:
        return _coordinate([word for word in words if word not in AXES], axes[0])
    if (
        len(words) == 1
        and words[0][-1] in AXES
        and (own := _coordinate([words[0][:-1]], words[0][-1]))
    ):
        return own
    left = [word for word in words if word not in NUMBER]
    return next(
        (name for name, known in WORDS.items() if len(left) == 1 and left[0] in known), None
    )


def _coordinate(words: list[str], axis: str) -> str | None:
    if len(words) != 1:
        return None
    if words[0] in ACTUAL:
        return f"{axis}_mm"
    return f"nominal_{axis}_mm" if words[0] in NOMINAL else None
