# destello's everyday commands. `make` lists them; CONTRIBUTING.md tells when to use which.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
export PIP_DISABLE_PIP_VERSION_CHECK := 1

PYTHON ?= python3
VENV ?= .venv
DEMO_VENV ?= .venv-demo
TEST_VENV ?= .venv-test
JOBS ?= 2
# What `make test` compiles for: PTX for the oldest supported GPU and machine code for Hopper. Empty: the build's own choice.
TEST_CUDA_ARCHS ?= 75-virtual;90-real
PYTEST_ARGS ?=

# Needed to build without isolation; nvcc is apart, because the CPU-only builds do without.
BUILD_REQUIREMENTS = "scikit-build-core>=1.1" "nanobind>=3.1" "cmake>=3.26" "ninja>=1.11"
SOURCES := $(shell find core bindings src cmake tools -type f -not -name '*.pyc' -not -name '_core.pyi' 2>/dev/null) \
           CMakeLists.txt pyproject.toml
CPP_SOURCES = $(shell find core bindings tests benches -name '*.h' -not -path '*/openpbr/*tables.h' -o -name '*.cpp' -o -name '*.cu' -o -name '*.cuh')
PYTHON_SOURCES = $(wildcard src tests tools benches examples)
SANITIZE_TESTS ?= $(wildcard tests/unit tests/cpp)

.PHONY: help demo dev dev-cuda test suite lint format sanitize wheel clean

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 20

# --- using it ---------------------------------------------------------------------------------------------------------
demo: $(DEMO_VENV)/.installed  ## install from this tree into its own environment and render the cover of the first book
	$(DEMO_VENV)/bin/destello render book1 --size 600x338 --spp 32 -o book1.png

$(DEMO_VENV)/.installed: $(SOURCES)
	[ -x $(DEMO_VENV)/bin/python ] || $(PYTHON) -m venv $(DEMO_VENV)
	$(DEMO_VENV)/bin/pip install .
	@touch $@

# --- working on it ----------------------------------------------------------------------------------------------------
# The build requirements live in the environment (no build isolation), so only what changed is compiled. One build at a time.
dev: $(VENV)/.ready  ## (re)build the editable install in $(VENV), CPU only; seconds after the first time
	@DST_CUDA=OFF VENV=$(VENV) tools/dev_build.sh

dev-cuda: $(VENV)/.ready  ## the same with the CUDA backend (nvcc from PyPI where the machine has none)
	@$(VENV)/bin/pip install -q "cuda-toolkit[nvcc,cudart,cccl]==13.0.*"
	@DST_CUDA=ON VENV=$(VENV) tools/dev_build.sh

$(VENV)/.ready: pyproject.toml
	[ -x $(VENV)/bin/python ] || $(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install -q $(BUILD_REQUIREMENTS)
	$(VENV)/bin/python tools/requirements.py dev | $(VENV)/bin/pip install -q -r /dev/stdin
	@touch $@

format:  ## rewrite all sources in the project's format, and fix what ruff can fix
	$(VENV)/bin/ruff check --fix $(PYTHON_SOURCES)
	$(VENV)/bin/ruff format $(PYTHON_SOURCES)
	$(VENV)/bin/clang-format -i $(CPP_SOURCES)

# --- checking it: everything, from nothing, as CI does ----------------------------------------------------------------
test: sanitize $(TEST_VENV)/.installed lint suite  ## sanitizers, isolated install with CUDA, linters, the whole test suite

suite: $(TEST_VENV)/.installed
	DESTELLO_EXPECT_CUDA_BUILD=1 $(TEST_VENV)/bin/python -m pytest -n $(JOBS) $(PYTEST_ARGS)

# In the development environment where there is one, else in that of `make test`.
LINT_VENV := $(if $(wildcard $(VENV)/.ready),$(VENV),$(TEST_VENV))
lint: $(LINT_VENV)/.ready  ## ruff, mypy (strict) and clang-format; changes nothing
	$(LINT_VENV)/bin/ruff check $(PYTHON_SOURCES)
	$(LINT_VENV)/bin/ruff format --check $(PYTHON_SOURCES)
	$(LINT_VENV)/bin/clang-format --dry-run -Werror $(CPP_SOURCES)
	$(LINT_VENV)/bin/mypy

# The module is built into a folder of its own and found through PYTHONPATH, before any installed destello.
sanitize: $(TEST_VENV)/.ready  ## the core's tests under AddressSanitizer and UBSan (CPU only)
	VENV=$(TEST_VENV) JOBS=$(JOBS) tools/sanitize.sh $(SANITIZE_TESTS)

# Isolated: pip fetches the build requirements, nvcc among them, as for a user.
$(TEST_VENV)/.installed: $(TEST_VENV)/.ready $(SOURCES)
	$(TEST_VENV)/bin/pip install -v --no-deps --force-reinstall . -C cmake.define.DST_CUDA=ON \
	  $(if $(TEST_CUDA_ARCHS),-C "cmake.define.CMAKE_CUDA_ARCHITECTURES=$(TEST_CUDA_ARCHS)")
	@cp $(TEST_VENV)/lib/python3.*/site-packages/destello/_core.pyi src/destello/  # for mypy
	@touch $@

$(TEST_VENV)/.ready: pyproject.toml
	[ -x $(TEST_VENV)/bin/python ] || $(PYTHON) -m venv $(TEST_VENV)
	$(TEST_VENV)/bin/pip install -q $(BUILD_REQUIREMENTS)
	$(TEST_VENV)/bin/python tools/requirements.py test all | $(TEST_VENV)/bin/pip install -q -r /dev/stdin
	@touch $@

wheel: $(VENV)/.ready  ## a release wheel for this Python in dist/, for all supported GPUs
	$(VENV)/bin/pip wheel --no-deps -w dist . -C cmake.define.DST_CUDA=ON \
	  -C "cmake.define.CMAKE_CUDA_ARCHITECTURES=75-virtual;80-real;86-real;89-real;90-real;120"

clean:  ## remove builds, caches and the demo and test environments (not $(VENV))
	rm -rf build dist $(DEMO_VENV) $(TEST_VENV) .pytest_cache .hypothesis .mypy_cache .ruff_cache src/destello/_core.pyi
