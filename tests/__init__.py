"""Tests of the Ballscrew Observer; they mirror the packages."""
