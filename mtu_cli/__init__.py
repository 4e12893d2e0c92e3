"""Machine tool uncertainty: from measurements of a machine to statements about its parts."""

__version__ = "0.1.0"
