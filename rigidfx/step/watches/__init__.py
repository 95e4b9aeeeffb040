"""Observers of attempts: the judge, who may object, and watches, which take note."""
