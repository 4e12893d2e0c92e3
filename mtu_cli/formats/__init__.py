"""Files of instruments and of controls: one module a vendor or family, each with what recognises
it, reads it, and writes it where the layout is documented; `instruments` and `control` are the
registries.
"""
