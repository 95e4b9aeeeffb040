"""What looks at attempts: the judge, who may object, and watches, which take note."""
