"""Shader files: a compiler's front end for GLSL, and what runs the program while JAX traces it.

The stages: `preprocessor` (macros and includes), `lexer`, `parser` with `operators` (the syntax tree); `context`, `access`,
`expressions`, `constructors`, `calls`, `statements` and `program`, one class in floors (names, types, overloads: each node
becomes a Python function of the machine); `machine` (variables, masks, loops) and `arithmetic` (which folds what is known).
`roles`, `knobs` and `shader` make a family of it. Nothing of a file is executed as Python.
"""
