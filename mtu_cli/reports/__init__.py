"""Results as tables, JSON documents, CSV rows and figures; nothing is estimated here."""
