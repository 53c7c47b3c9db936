# The commands of the project. `make stream` and `make test` need nothing but python3 >= 3.11, a C compiler
# and make: what is missing is installed, or named with the exact command to type.

PYTHON ?= python3
SCENE ?= wing
VENV := .venv
BIN := $(VENV)/bin
C_WARNINGS := -Wall -Wextra -Werror -Wshadow -Wvla -Wconversion -Wdouble-promotion

C_SOURCES := $(shell git ls-files '*.c' '*.h')
NATIVE_SOURCES := $(filter host/%,$(C_SOURCES))
FIRMWARE_SOURCES := $(filter hil/% firmware/%,$(C_SOURCES))

.PHONY: help setup stream firmware flash probe test soak pictures check bench format clean

help:
	@echo "make stream [SCENE=wing|sea|breath|file.py] [SECONDS=10]   emulated comb on a moving surface, live, in a page"
	@echo "make test      all tests and checks"
	@echo "make soak      a recording killed at 20 random moments, and ten minutes of view and recording"
	@echo "make pictures  the pictures of README.md, taken of the page"
	@echo "make firmware [BOARD=feather_f405]   the STM32F405 image, firmware/build/stm32f405/ribbon.bin"
	@echo "make flash [LINK=port]   the image into a board in DFU mode, or of the running ribbon at a port"
	@echo "make probe     checks a new sensor string on a board that runs MicroPython [PORT=] [BOARD=] [SLOTS=] [WALK=1]"
	@echo "make setup     .venv/bin/ribbonhost and .venv/bin/ribbonhil"
	@echo "make check     lint, format, types, generated files, compiler warnings"
	@echo "make bench     accuracy, speed and the latency of a stream, measured on this machine"
	@echo "make format    put all sources into the project's format"
	@echo "make clean     remove everything that was built"

# With job control Ctrl-C reaches the stream, which ends by itself, and not make, which would complain.
stream: setup
	@if [ -t 0 ]; then set -m; fi; $(BIN)/ribbonhost stream --emulate $(SCENE) --view $(if $(SECONDS),--seconds $(SECONDS))

setup: $(VENV)/.native $(VENV)/.firmware

# The image, and the emulated MCU that runs it. QEMU is for tests only.
firmware: $(VENV)/.model
	@.ci/system-packages $$(grep -v qemu firmware/packages.txt)
	@$(MAKE) --no-print-directory -C firmware

flash: firmware
	@.ci/system-packages dfu-util
	@$(MAKE) --no-print-directory -C firmware flash

probe: $(VENV)/.firmware $(VENV)/.probe
	@$(BIN)/python -m ribbonhil.probe.run $(if $(PORT),--port '$(PORT)') $(if $(BOARD),--board '$(BOARD)') \
	    $(if $(SLOTS),--slots '$(SLOTS)') $(if $(WALK),--walk)

# ensurepip and Python.h are packages of their own on Debian and Ubuntu.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "Python 3.11 or newer is needed, $(PYTHON) is $$($(PYTHON) -V 2>&1). Try make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || .ci/system-packages python3-venv
	@$(PYTHON) -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' || \
	    .ci/system-packages python3-dev
	@command -v cc >/dev/null || .ci/system-packages gcc libc6-dev
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(BIN)/python host/pyproject.toml host/setup.py hil/pyproject.toml hil/setup.py
	@echo "Installing ribbonhost and ribbonhil into $(VENV)"
	@$(BIN)/python -m pip install -q --disable-pip-version-check 'setuptools>=77' wheel 'cffi>=1.16'
	@$(BIN)/python -m pip install -q --disable-pip-version-check --no-build-isolation -e 'host[view]' -e hil
	@touch $@

$(VENV)/.native: $(VENV)/.installed $(NATIVE_SOURCES) host/ribbonhost/native/build.py
	@$(BIN)/python host/ribbonhost/native/build.py
	@touch $@

$(VENV)/.firmware: $(VENV)/.installed $(FIRMWARE_SOURCES) hil/ribbonhil/firmware_build.py
	@$(BIN)/python hil/ribbonhil/firmware_build.py
	@touch $@

$(VENV)/.probe: $(VENV)/.installed hil/probe/requirements.txt
	@$(BIN)/python -m pip install -q --disable-pip-version-check -r hil/probe/requirements.txt
	@touch $@

$(VENV)/.test: $(VENV)/.installed tests/requirements.txt tests/image/requirements-no-deps.txt hil/probe/requirements.txt \
    firmware/packages.txt
	@.ci/system-packages $$(cat firmware/packages.txt)
	@{ command -v chromium || command -v google-chrome; } >/dev/null || .ci/system-packages chromium
	@echo "Installing what the tests need into $(VENV)"
	@$(BIN)/python -m pip install -q --disable-pip-version-check -r tests/requirements.txt
	@$(BIN)/python -m pip install -q --disable-pip-version-check --no-deps -r tests/image/requirements-no-deps.txt
	@touch $@

$(VENV)/.model: $(VENV)/.firmware hil/ribbonhil/stm32f405/build.py hil/ribbonhil/stm32f405/requirements.txt
	@$(BIN)/python -m pip install -q --disable-pip-version-check -r hil/ribbonhil/stm32f405/requirements.txt
	@$(BIN)/python -m ribbonhil.stm32f405.build
	@touch $@

# Many tests run in real time and mostly wait: three workers fill two cores. Threads of their linear algebra would
# only get into each other's way.
test: check
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 3 --dist worksteal tests

soak: setup $(VENV)/.test
	@RIBBON_SOAK_KILLS=20 $(BIN)/python -m pytest -q tests/record/test_recording.py -k killed
	@OPENBLAS_NUM_THREADS=1 $(BIN)/ribbonhost bench calibration --seeds 20
	@RIBBON_SOAK_VIEW_S=600 $(BIN)/python -m pytest -q -s tests/view/test_endurance.py

pictures: setup $(VENV)/.test
	@PYTHONPATH=tests $(BIN)/python -m view.take_pictures

check: setup $(VENV)/.test $(VENV)/.model
	@$(BIN)/ruff check --config host/pyproject.toml .
	@$(BIN)/ruff format --check --config host/pyproject.toml .
	@$(BIN)/clang-format --dry-run -Werror $(C_SOURCES)
	@$(BIN)/mypy --config-file host/pyproject.toml host/ribbonhost hil/ribbonhil hil/checks protocol/generate.py
	@$(BIN)/python protocol/generate.py --check
	@$(BIN)/python hil/ribbonhil/firmware_build.py --check
	@$(BIN)/python -m ribbonhil.stm32f405.build --check
	@$(CC) -std=c11 $(C_WARNINGS) -fsyntax-only $(filter %.c,$(NATIVE_SOURCES))

bench: setup
	@$(BIN)/ribbonhost bench accuracy
	@$(BIN)/ribbonhost bench speed
	@$(BIN)/ribbonhost stream --emulate $(SCENE) --seconds 10

format: $(VENV)/.test
	@$(BIN)/ruff check --fix --config host/pyproject.toml .
	@$(BIN)/ruff format --config host/pyproject.toml .
	@$(BIN)/clang-format -i $(C_SOURCES)

clean:
	git clean -fdxq -e .hypothesis
