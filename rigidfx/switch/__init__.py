"""Apply a decision: exchange momenta and energy between cells and bodies."""
