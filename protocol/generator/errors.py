"""What is raised for a schema that breaks a rule."""


class SchemaError(Exception):
    """The schema breaks a rule; the message says which, where, and what to do."""
