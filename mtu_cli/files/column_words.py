"""What measuring programs call the columns of points and of readings, in a few languages."""

from __future__ import annotations

import re
import unicodedata

WORDS = {
    "part": ("part", "workpiece", "piece", "serial", "ser", "sample", "specimen", "werkstuck",
             "werkstueck", "teil", "bauteil", "prufteil", "prufling", "pruefling", "serien",
             "stuck", "stueck", "werkst", "wst", "barcode", "dmc", "pieza", "pezzo"),
    "feature": ("feature", "hole", "bore", "characteristic", "char", "element", "merkmal",
                "prufmerkmal", "pruefmerkmal", "messmerkmal", "messelement", "prufposition",
                "pruefposition", "circle", "kreis", "bohrung", "bhrg", "loch", "punkt", "messpunkt",
                "caracteristique", "alesage", "trou",
                "caracteristica", "agujero", "taladro", "foro"),
    "repeat": ("repeat", "repetition", "wiederholung", "repeticion", "ripetizione"),
    "component": ("component", "komponente", "composante", "componente"),
    "error": ("error", "err", "deviation", "dev", "abweichung", "abw", "fehler", "messabweichung",
              "erreur", "ecart", "desviacion", "errore", "scostamento"),
    "unit": ("unit", "units", "einheit", "masseinheit", "unite", "unidad", "unita"),
    "position_mm": ("position", "pos", "messposition", "posicion", "posizione"),
    "direction": ("direction", "richtung", "sens", "direccion", "sentido", "direzione",
                  "senso"),
    "sequence": ("sequence", "sequenz", "reihenfolge", "secuencia", "sequenza"),
    "time": ("time", "zeit", "timestamp", "zeitstempel", "datetime"),
}  # fmt: skip
APPROACH = ("approach", "anfahrrichtung", "anfahrt", "approche")
"""Beside the words of directions: along which way the axis came to a point."""
ACTUAL = ("actual", "act", "measured", "meas", "measurement", "ist", "istmass", "istwert",
          "gemessen", "gem", "mess", "messwert", "mesure", "mesuree", "medido", "medida", "real",
          "misurato")  # fmt: skip
NOMINAL = ("nominal", "nom", "soll", "sollmass", "sollwert", "nenn", "nennmass", "nennwert",
           "theo", "theoretical", "theorique", "nominale", "teorico", "target", "targ", "cad",
           "design", "basic")  # fmt: skip
"""Without accents and in lower case; `x`, `y` or `z` stands before or behind."""
AXIS = ("axis", "achse", "axe", "eje", "asse")
"""Of a report with a row for each of them."""
VALUE = ("value", "val", "wert", "mass", "coordinate", "coord", "koordinate", "koord", "valeur",
         "coordonnee", "valor", "coordenada", "valore", "coordinata")  # fmt: skip
"""Of a coordinate, it is the measured one; beside ACTUAL and NOMINAL they say nothing more."""
NUMBER = {"no", "nr", "n", "number", "id", "num", "numero", "nummer"}
NAME = {"name", "bezeichnung"}
NAMING = NUMBER | NAME | {"ident", "label", "code", "tag"}
ENDS = sorted((NUMBER | NAME) - {"n"}, key=len, reverse=True)
"""What stands behind a word without a gap: `Teilenummer`, `PartNo`."""
LINKS = ("", "e", "s")
"""Between them in German: `Teile-Nr.`, `Merkmalsname`."""
IDENTIFIED = ("part", "feature", "repeat", "component", "sequence")
"""What has a number or a name; that of an error or a time is something else."""
COUNTED = ("repeat", "sequence")
"""What has a number alone: a `Sequence name` is of an operation."""
NOMINAL_SIGN = "n"
"""Behind the axis, as in `Xn`; before it (`nx`) it is of a normal."""
MINUTES = "min"
UNIT = "mm"
AXES = ("x", "y", "z")
_WAYS = (*WORDS["direction"], *APPROACH)
LONGEST = 200
"""Signs of a name that are looked at: none of those known is nearly so long."""


def meant_by(other: str) -> str | None:
    """The column that common words mean: `part` by `Werkstück-Nr.`, `nominal_x_mm` by
    `Nennmaß X [mm]`. One of several that are counted (`Ist X 2`) is none of them.
    """
    told = plain(other)
    words = [word for word in re.findall("[a-z]+", told) if word != UNIT]
    if re.search("[0-9]", told):
        return None
    axes = [word for word in words if word in AXES]
    if len(axes) == 1:
        return _coordinate([word for word in words if word not in AXES], axes[0])
    for word in words if len(words) == 1 else ():
        if own := nominal_by_sign(word):
            return own
        for axis, rest in ((word[0], word[1:]), (word[-1], word[:-1])):
            if axis in AXES and (own := _coordinate([rest], axis)):
                return own
    return _named(words)


def nominal_by_sign(other: str) -> str | None:
    """The column that `Xn` means, or a normal: its cells tell which."""
    word = plain(other).removesuffix(UNIT).strip(" _-[]()")
    return f"nominal_{word[0]}_mm" if re.fullmatch("[xyz]" + NOMINAL_SIGN, word) else None


def _named(words: list[str]) -> str | None:
    """What is not along an axis, by its word, its number or its name."""
    left = [word for word in words if word not in NUMBER | NAME]
    if MINUTES in left[1:]:
        left.remove(MINUTES)
        return "time_min" if len(left) == 1 and left[0] in WORDS["time"] else None
    if len(left) != 1:
        return None
    end = next((end for end in ENDS if left[0].endswith(end) and left[0] != end), "")
    stem = left[0].removesuffix(end)
    identified = bool(end) or len(left) < len(words)
    meant = {left[0], *(stem.removesuffix(link) for link in LINKS if identified)}
    names = (name for name, known in WORDS.items() if not meant.isdisjoint(known))
    by_name = end in NAME or not NAME.isdisjoint(words)
    fit = (name for name in names if not (by_name and name in COUNTED))
    return next((name for name in fit if not identified or name in IDENTIFIED), None)


def may_name(other: str) -> bool:
    """Whether a column that no known word explains tells one thing from another: `Ident-Nr.`."""
    words = re.findall("[a-z]+", plain(other))
    return meant_by(other) is None and not NAMING.isdisjoint(words)


def direction_along(other: str) -> str | None:
    """The column `dir_x` that `Richtung_x` or `approach X` may mean, where its cells are signs."""
    words = [word for word in re.findall("[a-z]+", plain(other)) if word not in AXIS]
    words = [word for word in words if word != "dir" or len(words) < 3]
    if len(words) == 1 and words[0][:-1] in _WAYS:
        words = [words[0][:-1], words[0][-1]]
    axes = [word for word in words if word in AXES]
    ways = [word for word in words if word in _WAYS]
    return f"dir_{axes[0]}" if len(axes) == 1 and ways and len(words) == 1 + len(ways) else None


def direction_alone(other: str) -> bool:
    """Whether a column is called a direction, of whatever axis: `Anfahrrichtung`."""
    words = re.findall("[a-z]+", plain(other))
    return bool(words) and all(word in _WAYS for word in words)


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
