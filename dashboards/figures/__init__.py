"""The figures of a sweep as data, one module each."""
