"""The STM32F405 as a model: runs the image that is flashed, byte for byte."""
