"""The tables of a configuration: every unit and every range of them, checked once, here."""
