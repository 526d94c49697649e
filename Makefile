# destello's everyday commands; CONTRIBUTING.md tells when to use which.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

PYTHON ?= python3
VENV ?= .venv
DEV_BUILD = $(wildcard build/cp*/CMakeCache.txt)

.PHONY: help dev

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 20

# The build requirements live in the environment (no build isolation), so only what changed is compiled. One build at a time.
dev: $(VENV)/.ready  ## (re)build the editable install in $(VENV), CPU only; seconds after the first time
	@mkdir -p build && exec 9>build/.lock && flock 9 && \
	if [ -n "$(DEV_BUILD)" ] && $(VENV)/bin/python -c 'import destello._core' 2>/dev/null; then \
	  cmake=$(VENV)/bin/cmake; site=$$($(VENV)/bin/python -c 'import sysconfig; print(sysconfig.get_path("platlib"))'); \
	  $$cmake --build $(dir $(firstword $(DEV_BUILD))) && \
	  $$cmake --install $(dir $(firstword $(DEV_BUILD))) --prefix $$site >/dev/null; \
	else \
	  $(VENV)/bin/pip install -q --no-build-isolation --no-deps -e . -C cmake.define.DST_CUDA=OFF; \
	fi

$(VENV)/.ready: pyproject.toml
	@[ -x $(VENV)/bin/python ] || $(PYTHON) -m venv $(VENV)
	@$(VENV)/bin/pip install -q "scikit-build-core>=1.1" "nanobind>=3.1" "cmake>=3.26" ninja
	@$(VENV)/bin/python tools/requirements.py dev | $(VENV)/bin/pip install -q -r /dev/stdin
	@touch $@
