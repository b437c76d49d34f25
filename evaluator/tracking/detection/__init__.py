"""Detection of the marks in a frame: coloured regions, their selection, lookalikes."""
