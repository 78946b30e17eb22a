"""Where methods hold, lose digits, lie or break: rules over a matrix of lobes, exponents, angles, precisions and modes."""
