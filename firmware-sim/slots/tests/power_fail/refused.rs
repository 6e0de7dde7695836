//! Updates and layouts that are refused.

use super::{CAPACITY, CHUNK, Flash, Shipped, assert_runs, erased, floor, open, update};
use futures::executor::block_on;
use reagent_slots::ram::RamError;
use reagent_slots::{Floor, Layout, SlotError, Slots};

#[test]
fn what_does_not_belong_is_refused() {
    let [old, new] = [5, 6].map(Shipped::new);
    let mut memory = erased();
    let mut slots = open(Flash::new(&mut memory)).expect("erased");
    let incomplete = |r: Result<(), SlotError<RamError>>| {
        assert!(matches!(r, Err(SlotError::Incomplete)), "{r:?}");
    };
    block_on(async {
        incomplete(slots.write_chunk(0, &[1]).await);
        incomplete(slots.confirm(floor(9)).await);
        let long = slots.begin(&new.frame, 1 << 20, &new.table()).await;
        assert!(matches!(long, Err(SlotError::TooLarge { .. })), "{long:?}");
        let long = slots.begin(&[0; 1025], 10, &[[0; 32]]).await;
        assert!(matches!(long, Err(SlotError::TooLarge { .. })), "{long:?}");
    });
    update(&mut slots, &new).expect("power");
    let older = update(&mut slots, &old);
    assert!(
        matches!(
            older,
            Err(SlotError::Version {
                version: Floor { version: 5, .. },
                floor: Floor { version: 6, .. }
            })
        ),
        "{older:?}"
    );
    let mut slots = open(Flash::new(&mut memory)).expect("a record");
    assert_runs(&mut slots, &[&new], "after an older policy");
    let old = Shipped::new(4);
    block_on(async {
        slots
            .begin(&old.frame, old.file.len() as u32, &old.table())
            .await
            .expect("power");
        let wrong = slots.write_chunk(1, &old.file[..CHUNK]).await;
        assert!(
            matches!(wrong, Err(SlotError::Hash { index: 1 })),
            "{wrong:?}"
        );
        for (index, length) in [(0, 1), (2, 78), (3, 1), (0, 0), (u32::MAX, 1)] {
            let wrong = slots.write_chunk(index, &old.file[..length]).await;
            assert!(matches!(wrong, Err(SlotError::Length { .. })), "{wrong:?}");
        }
        incomplete(slots.try_out().await.map(|_| ()));
    });
}

#[test]
fn layouts_that_cannot_work_are_refused() {
    let good = Layout::over::<Flash<'_>>(CAPACITY as u32, CHUNK as u32);
    let broken = [
        Layout {
            chunk: 100,
            ..good.clone()
        },
        Layout {
            chunk: 0,
            ..good.clone()
        },
        Layout {
            chunk: 1 << 20,
            ..good.clone()
        },
        Layout {
            records: [0..128, 6400..6656],
            ..good.clone()
        },
        Layout {
            records: [0..256, 6400..6528],
            ..good.clone()
        },
        Layout {
            records: [0..512, 6400..6656],
            ..good.clone()
        },
        Layout {
            records: [0..256, 0..256],
            ..good.clone()
        },
        Layout {
            records: [1..257, 6400..6656],
            ..good.clone()
        },
        Layout {
            slots: [256..256, 256..256],
            ..good.clone()
        },
        Layout {
            slots: [256..3328, 3328..64000],
            ..good.clone()
        },
    ];
    for layout in broken {
        let mut memory = erased();
        let opened = block_on(Slots::open(Flash::new(&mut memory), layout.clone()));
        assert!(
            matches!(opened.err(), Some(SlotError::Layout(_))),
            "{layout:?}"
        );
    }
}
