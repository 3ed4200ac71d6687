.PHONY: build full render test count bindings embree denoiser packages help

FULL = --release --locked --features oiio

help:
	@echo 'make build    fetch Embree if none is found; build target/release/whitewater'
	@echo 'make full     the same with OpenImageIO (installs Debian packages when it may) and Open Image Denoise'
	@echo 'make render   build, then render scenes/valley to out/valley.exr and out/valley.png'
	@echo 'make test     full, then every test'
	@echo 'make denoiser fetch Open Image Denoise if none is found: `whitewater render --denoise` needs it'
	@echo 'make count    print instructions per ray of the inner loops, counted by valgrind'
	@echo 'make bindings EMBREE_INCLUDE=DIR   make ffi/embree/bindings.rs anew from DIR/embree4/*.h and check it'

embree:
	@scripts/fetch-embree.sh

denoiser:
	@scripts/fetch-oidn.sh

packages:
	@scripts/install-packages.sh

build: embree
	cargo build --release --locked

# Denoising is loaded at run time: without it all is built, and all but its tests pass.
full: embree packages
	@scripts/fetch-oidn.sh || echo 'Going on without Open Image Denoise: render --denoise and its tests will fail.' >&2
	cargo build $(FULL)

render: build
	@mkdir -p out
	target/release/whitewater render scenes/valley/scene.toml -o out/valley.exr -o out/valley.png
	@echo "wrote $(CURDIR)/out/valley.exr and $(CURDIR)/out/valley.png"

test: full
	cargo test $(FULL) --no-fail-fast

count: full
	@scripts/count-instructions.sh $(FULL)

bindings:
	EMBREE_WRITE=1 cargo test --features regen --lib embree::tests
