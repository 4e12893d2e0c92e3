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
    "repeat": ("repeat", "repetition", "wiederholung", "repeticion", "ripetizione"),
    "component": ("component", "komponente", "composante", "componente"),
    "error": ("error", "err", "deviation", "dev", "abweichung", "abw", "fehler", "messabweichung",
              "erreur", "ecart", "desviacion", "errore", "scostamento"),
    "unit": ("unit", "units", "einheit", "masseinheit", "unite", "unidad", "unita"),
    "position_mm": ("position", "pos", "messposition", "posicion", "posizione"),
}  # fmt: skip
ACTUAL = ("actual", "act", "measured", "meas", "measurement", "ist", "istmass", "istwert",
          "gemessen", "mess", "messwert", "mesure", "mesuree", "medido", "medida", "real",
          "misurato")  # fmt: skip
NOMINAL = ("nominal", "nom", "soll", "sollmass", "sollwert", "nennmass", "nennwert", "theorique",
           "nominale", "teorico")  # fmt: skip
"""Without accents and in lower case; `x`, `y` or `z` stands before or behind."""
VALUE = ("value", "val", "wert", "mass", "coordinate", "coord", "koordinate", "koord", "valeur",
         "coordonnee", "valor", "coordenada", "valore", "coordinata")  # fmt: skip
"""Of a coordinate, it is the measured one; beside ACTUAL and NOMINAL they say nothing more."""
NUMBER = {"no", "nr", "n", "number", "id", "num", "numero"}
UNIT = "mm"
AXES = ("x", "y", "z")
LONGEST = 200
"""Signs of a name that are looked at: none of those known is nearly so long."""


def by_common_word(name: str, others: Iterable[str]) -> str | None:
    """The first of other columns that common words say is the column `name`."""
    return next((other for other in others if meant_by(other) == name), None)


def meant_by(other: str) -> str | None:
    """The column that common words mean: `part` by `Werkstück-Nr.`, `nominal_x_mm` by
    `Nennmaß X [mm]`.
    """
    words = [word for word in re.findall("[a-z]+", plain(other)) if word != UNIT]
    axes = [word for word in words if word in AXES]
    if len(axes) == 1:
        return _coordinate([word for word in words if word not in AXES], axes[0])
    for word in words if len(words) == 1 else ():
        for axis, rest in ((word[0], word[1:]), (word[-1], word[:-1])):
            if axis in AXES and (own := _coordinate([rest], axis)):
                return own
    left = [word for word in words if word not in NUMBER]
    return next(
        (name for name, known in WORDS.items() if len(left) == 1 and left[0] in known), None
    )


def _coordinate(words: list[str], axis: str) -> str | None:
    kinds = [word for word in words if word not in VALUE]
    if not words or len(kinds) > 1:
        return None
    if not kinds or kinds[0] in ACTUAL:
        return f"{axis}_mm"
    return f"nominal_{axis}_mm" if kinds[0] in NOMINAL else None


def plain(name: str) -> str:
    """A name without accents and in lower case; of a damaged file's megabytes the beginning."""
    signs = unicodedata.normalize("NFKD", name[:LONGEST].casefold())
    return "".join(sign for sign in signs if not unicodedata.combining(sign))
