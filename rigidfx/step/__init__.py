"""One time step: state in, result out."""
