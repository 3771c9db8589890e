"""Make the embedded default: raw NTU files of two people, and the law that made them.

Usage: python -m stages.synthesise RAW
"""
